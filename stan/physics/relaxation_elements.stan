/**
 * A Kelvin part with many relaxation times as a sum of elements: where they lie and how much each
 * gives. The laws are those of physics/relaxation.stan.
 *
 * Andrade creep (t/tau)^a has times without end, at the density a/Gamma(1 - a) (t/tau)^a over ln t.
 * Those that a test can tell apart are a sum as well; all faster ones, which follow at once, and all
 * slower ones, which only flow, are an element each, with their compliance and mean time, or with
 * their flow and what it slows down by.
 */

/** Parts of a law that an element may belong to, in the first column of `element`. */
int is_only_element() { return 0; }
int is_of_band() { return 1; }
int is_of_peak() { return 2; }
int is_of_andrade() { return 3; }
int is_faster() { return 4; } // all times of Andrade creep below a place
int is_slower() { return 5; } // all above

/** Whether elements of a part are among them. */
int has_part(data matrix element, data int which) {
  for (k in 1 : rows(element)) {
    if (element[k, 1] == which) {
      return 1;
    }
  }
  return 0;
}

int n_relaxation_numbers() { return 7; }

/**
 * Numbers that the elements follow from: ln(tau_H/tau_L), alpha, Delta_P E_K/E_M, ln(tau_H/tau_P),
 * sigma_P, ln(tau/s) at T_0 and d_K, and a of Andrade creep.
 *
 * @param parameter in the order of physics/parameters.stan
 */
vector relaxation_numbers(vector parameter) {
  return [log(10) * parameter[i_relaxation_time_decades()], parameter[i_relaxation_exponent()],
          parameter[i_peak_strength()] * parameter[i_kelvin_modulus()]
          / parameter[i_maxwell_modulus()],
          log(10) * parameter[i_peak_time_decades()], parameter[i_peak_width()],
          log(parameter[i_kelvin_viscosity()] / parameter[i_kelvin_modulus()]),
          parameter[i_andrade_exponent()]]';
}

/** Whether a free parameter changes each of these numbers, and the elements with it. */
array[] int relaxation_numbers_vary(data array[] int is_free, data matrix element) {
  return {is_free[i_relaxation_time_decades()], is_free[i_relaxation_exponent()],
          has_part(element, is_of_peak())
          * max(is_free[{i_peak_strength(), i_kelvin_modulus(), i_maxwell_modulus()}]),
          is_free[i_peak_time_decades()], is_free[i_peak_width()],
          has_part(element, is_of_andrade())
          * max(is_free[{i_kelvin_modulus(), i_kelvin_viscosity()}]),
          is_free[i_andrade_exponent()]};
}

/**
 * Decay of each element over E_K/eta_K, and its compliance over 1/E_K.
 *
 * @param element a row each: the part of the law that it belongs to; its place in the band, from 0
 *   at the shortest to 1 at the longest ln(time), in the peak, in standard deviations of ln(time), or,
 *   of Andrade creep, its ln(time/s) at T_0 and d_K; its weight in an integral over the place
 * @param number relaxation_numbers()
 * @return (n, 2)
 */
matrix relaxation_elements(data matrix element, vector number) {
  int n = rows(element);
  real width = number[1];
  real exponent = number[2];
  real a = number[7];
  real density = width == 0 ? 1 : exponent * width / -expm1(-exponent * width);
  real andrade_density = a / tgamma(1 - a);
  matrix[n, 2] elements;
  for (k in 1 : n) {
    if (element[k, 1] == is_of_band()) {
      real below = (1 - element[k, 2]) * width;
      elements[k] = [exp(below), element[k, 3] * density * exp(-exponent * below)];
    } else if (element[k, 1] == is_of_peak()) {
      elements[k] = [exp(number[4] - number[5] * element[k, 2]), element[k, 3] * number[3]];
    } else if (element[k, 1] == is_only_element()) {
      elements[k] = [1, 1];
    } else {
      real below = number[6] - element[k, 2];
      real slower = 1;
      real softer = element[k, 3];
      if (element[k, 1] == is_faster()) {
        slower = a / (1 + a);
        softer = 1 / a;
      } else if (element[k, 1] == is_slower()) {
        slower = (2 - a) / (1 - a);
        softer = slower / (1 - a);
      }
      elements[k] = [exp(below) / slower, softer * andrade_density * exp(-a * below)];
    }
  }
  return elements;
}
