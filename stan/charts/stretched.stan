/**
 * A positive number by its logarithm where it is far below a scale, and by itself above it.
 *
 * What is too small for data to see is as wide as its prior, in its logarithm; of what they see they
 * fix the number itself. With either alone for a coordinate, steps that suit one are far too long or
 * too short for the other.
 */

/** ln(number/scale) at a stretched coordinate, and ln of its derivative by the coordinate. */
vector log_from_stretched(real stretched) {
  real log_number = log(log1p_exp(stretched));
  return [log_number, log_inv_logit(stretched) - log_number]';
}

/** The stretched coordinate of number/scale: log_from_stretched() inverted. */
real stretched_from(real number) {
  return number + log1m_exp(-number); // ln(exp(number) - 1)
}
