/**
 * Coordinates in which the elastic rise of a curve is straight: of moduli that lean on a bound, and
 * of two springs that give together.
 */

/**
 * Columns of a row of `quantity` behind those of charts/plain.stan: plain coordinate at the mode, from
 * where on the parameter is linear (see plain_from_straightened()), and the power of the noise with
 * which its width grows.
 */
int i_mode() { return 5; }
int i_linear() { return 6; }
int i_power() { return 7; }

/**
 * Plain coordinate of a parameter, straightened: linear in the parameter or in its inverse.
 *
 * Data can push a parameter against its lower bound (the Kelvin modulus of ice). There the plain
 * coordinate is logarithmic and runs away; ln(c log1p_exp(x)) is linear in the parameter above c.
 * Of the Maxwell modulus they fix the inverse, to which elastic strain is proportional, and that
 * only together with what the Kelvin element adds (loading_compliance()).
 *
 * @param displacement from the reference point, in the straightened coordinate
 * @param quantity of the parameter; its column i_linear() has c > 0: linear in exp(plain) above c;
 *   c < 0: linear in exp(-plain) above -c; 0: plain
 * @return plain coordinate, and ln of its derivative by the displacement
 */
vector plain_from_straightened(real displacement, data row_vector quantity) {
  real sign = quantity[i_linear()] > 0 ? 1 : -1;
  real c = sign * quantity[i_linear()];
  real x;
  if (c == 0) {
    return [quantity[i_mode()] + displacement, 0]';
  }
  x = log(expm1(exp(sign * quantity[i_mode()]) / c)) + sign * displacement;
  return [sign * log(c * log1p_exp(x)), log_inv_logit(x) - log(log1p_exp(x))]';
}

/**
 * Compliance of a Kelvin part under a stress that has grown in proportion to time.
 *
 * That of an element is that of its spring long after its Kelvin time, and that of its dashpot long
 * before it.
 *
 * @param kelvin modulus (Pa) and viscosity (Pa s) of each element
 * @return Kelvin strain over stress (1/Pa)
 */
real loading_compliance(matrix kelvin, real time) {
  real compliance = 0;
  for (j in 1 : rows(kelvin)) {
    real x = time * kelvin[j, 1] / kelvin[j, 2];
    compliance += (1 + expm1(-x) / x) / kelvin[j, 1];
  }
  return compliance;
}

/** Largest share of the spring's compliance at the reference point that a Kelvin element takes. */
real largest_share_of_spring() { return 0.9; }

/**
 * What the Kelvin element takes over of the compliance in the elastic rise, so that a part of it is
 * left to the spring, whose modulus would else run away where that element is the softer one.
 *
 * @param compliance of the element, in any unit
 * @param spring compliance of the spring at the reference point, in the same unit
 */
real left_to_spring(real compliance, data real spring) {
  real limit = largest_share_of_spring() * spring;
  return limit - log1p_exp(limit - compliance);
}
