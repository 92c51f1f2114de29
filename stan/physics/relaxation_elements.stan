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

/**
 * Decay of each element over E_K/eta_K, and its compliance over 1/E_K.
 *
 * @param element a row each: the part of the law that it belongs to; its place in the band, from 0
 *   at the shortest to 1 at the longest ln(time), in the peak, in standard deviations of ln(time), or,
 *   of Andrade creep, its ln(time/s) at T_0 and d_K; its weight in an integral over the place
 * @param width ln(tau_H/tau_L)
 * @param exponent alpha
 * @param strength Delta_P E_K/E_M
 * @param shift ln(tau_H/tau_P)
 * @param spread sigma_P
 * @param longest ln(tau/s) at T_0 and d_K
 * @param a of Andrade creep
 * @return (n, 2)
 */
matrix relaxation_elements(data matrix element, real width, real exponent, real strength,
                           real shift, real spread, real longest, real a) {
  int n = rows(element);
  real density = width == 0 ? 1 : exponent * width / -expm1(-exponent * width);
  real andrade_density = a / tgamma(1 - a);
  matrix[n, 2] elements;
  for (k in 1 : n) {
    if (element[k, 1] == is_of_band()) {
      real below = (1 - element[k, 2]) * width;
      elements[k] = [exp(below), element[k, 3] * density * exp(-exponent * below)];
    } else if (element[k, 1] == is_of_peak()) {
      elements[k] = [exp(shift - spread * element[k, 2]), element[k, 3] * strength];
    } else if (element[k, 1] == is_only_element()) {
      elements[k] = [1, 1];
    } else {
      real below = longest - element[k, 2];
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
