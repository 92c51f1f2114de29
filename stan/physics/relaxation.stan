/**
 * Linear laws of the Kelvin part: its complex compliance at an angular frequency omega,
 * J(omega) = storage - i loss; the same parts as sums of elements, for solutions in time; and the
 * density of their relaxation times.
 *
 * With the relaxation time tau = eta_K/E_K at the temperature and grain size of the row,
 *
 *   one element   J = (1/E_K)/(1 + i omega tau)
 *   band          J = (1/E_K) integral of p(t)/(1 + i omega t) dt,  p ~ t^(alpha - 1) between
 *                 tau_L = tau/10^decades and tau_H = tau, with the integral 1
 *   and a peak    J + (Delta_P/E_M) integral of q(t)/(1 + i omega t) dt, q log-normal about
 *                 tau_P = tau/10^peak_decades with the standard deviation sigma_P of ln(t); with
 *                 sigma_P = 0 a second element of the time tau_P
 *   Andrade       J = (1/E_K) Gamma(1 + a) (i omega tau)^-a, the creep (t/tau)^a/E_K
 *
 * (band and peak: Jackson and Faul 2010, Physics of the Earth and Planetary Interiors 183,
 * 151-163; their Delta_B, of torsion, is 3 G/E_K). All times of a row are slower by one factor at
 * another temperature, exp[(Q_K/R)(1/T - 1/T_0)], and grain size, (d/d_K)^m_K.
 *
 * Andrade creep has times without end, at the density a/Gamma(1 - a) (t/tau)^a over ln t. Those
 * that a test can tell apart are a sum as well; all faster ones, which follow at once, and all
 * slower ones, which only flow, are an element each, with their compliance and mean time, or with
 * their flow and what it slows down by.
 *
 * Integrals are exact to about 1e-9 and have derivatives: that over the band by the incomplete
 * integral below, that over the peak by a trapezoid rule without the error of its poles. Needs
 * physics/parameters.stan, physics/flow_law.stan, physics/environment.stan and
 * physics/kelvin_laws.stan.
 */

/**
 * Polynomial in y that is 1/(1 + y) for y in [0, 1] but for 3e-10: its Chebyshev series up to y^12.
 */
vector reciprocal_polynomial() {
  return [0.999999999809, -0.999999933417, 0.999996120737, -0.999910435527, 0.998913113685,
          -0.992022951323, 0.961536429158, -0.871322578952, 0.688915957102, -0.436096442972,
          0.199836274818, -0.057565040157, 0.007719487175]';
}

/**
 * Coefficients, by powers of x^2, of x^-alpha times the integral of s^(alpha - 1)/(1 + s^2) over s
 * from 0 to x <= 1; with alpha + 1 in place of alpha, of that of s^alpha/(1 + s^2), over x.
 */
vector incomplete_coefficients(real exponent) {
  vector[13] reciprocal = reciprocal_polynomial();
  vector[13] power;
  for (k in 1 : 13) {
    power[k] = 2 * (k - 1);
  }
  return reciprocal ./ (exponent + power);
}

/** Value of a polynomial given its coefficients from that of power 0. */
real polynomial_value(vector coefficients, real y) {
  int n = num_elements(coefficients);
  real value = coefficients[n];
  for (k in 1 : n - 1) {
    value = fma(value, y, coefficients[n - k]);
  }
  return value;
}

/**
 * x^-alpha times the integral of s^(alpha - 1)/(1 + i s) ds from 0 to x: storage and loss.
 *
 * Beyond 1 it is the integral to infinity less its tail, which 1/s turns into the same integral
 * with the exponent 1 - alpha.
 *
 * @param log_x ln(x)
 * @param exponent alpha, between 0 and 1
 * @param coefficients of `incomplete_coefficients`, in columns: of alpha, alpha + 1, 1 - alpha and
 *   2 - alpha
 */
vector incomplete_relaxation(real log_x, real exponent, matrix coefficients) {
  int beyond = log_x > 0;
  real x = exp(beyond ? -log_x : log_x);
  real y = square(x);
  real even = polynomial_value(col(coefficients, beyond ? 3 : 1), y);
  real odd = x * polynomial_value(col(coefficients, beyond ? 4 : 2), y);
  if (beyond) {
    real whole = 0.5 * pi() * exp(-exponent * log_x);
    return [whole / sin(0.5 * pi() * exponent) - x * odd,
            whole / cos(0.5 * pi() * exponent) - x * even]';
  }
  return [even, odd]';
}

/**
 * Storage and loss of a band of relaxation times, density ~ t^(alpha - 1), over its relaxed
 * compliance.
 *
 * @param log_x ln(omega tau_H), shape (n)
 * @param exponent alpha, between 0 and 1
 * @param log_width ln(tau_H/tau_L), positive
 * @return (n, 2)
 */
matrix band_compliance(vector log_x, real exponent, real log_width) {
  int n = num_elements(log_x);
  matrix[13, 4] coefficients
    = append_col(append_col(incomplete_coefficients(exponent),
                            incomplete_coefficients(exponent + 1)),
                 append_col(incomplete_coefficients(1 - exponent),
                            incomplete_coefficients(2 - exponent)));
  real shortest = exp(-exponent * log_width);
  real scale = -exponent / expm1(-exponent * log_width);
  matrix[n, 2] compliance;
  for (i in 1 : n) {
    compliance[i]
      = scale
        * (incomplete_relaxation(log_x[i], exponent, coefficients)
           - shortest * incomplete_relaxation(log_x[i] - log_width, exponent, coefficients))';
  }
  return compliance;
}

/** Storage and loss of one element over its relaxed compliance, ln(omega tau) given; (n, 2). */
matrix element_compliance(vector log_x) {
  return append_col(inv_logit(-2 * log_x), 0.5 * inv(cosh(log_x)));
}

/**
 * Storage and loss of a log-normal peak of relaxation times over its relaxed compliance.
 *
 * The trapezoid rule in the standardised logarithm of the time errs by the poles of
 * 1/(1 + i omega t), at imaginary parts pi/2, 3 pi/2, ... of ln(omega t): their shares are taken
 * off. Those so far out that the normal density grows faster than the shares fall do not count.
 *
 * @param log_x ln(omega tau_P), shape (n)
 * @param width standard deviation of ln(t)
 * @return (n, 2)
 */
matrix peak_compliance(vector log_x, real width) {
  real step = 0.8;
  int n_nodes = 27;
  int n = num_elements(log_x);
  vector[n_nodes] node;
  vector[n_nodes] weight;
  matrix[n, 2] compliance;
  for (j in 1 : n_nodes) {
    node[j] = step * (j - 14);
    weight[j] = step * exp(std_normal_lpdf(node[j]));
  }
  for (i in 1 : n) {
    vector[n_nodes] log_time = log_x[i] + width * node;
    real storage = dot_product(weight, inv_logit(-2 * log_time));
    real loss = 0.5 * dot_product(weight, inv(cosh(log_time)));
    int sign = 1;
    int pole = 1;
    while (pole * step < 4 * width && pole < 12) {
      real height = 0.5 * pi() * pole;
      real decay = exp(-2 * pi() * height / (width * step));
      real turn = 2 * pi() * log_x[i] / (width * step);
      real phase = height * log_x[i] / square(width);
      real size = 2 * pi() / width
                  * exp(0.5 * (square(height) - square(log_x[i])) / square(width)
                        - 0.5 * log(2 * pi()))
                  * decay / (1 - 2 * decay * cos(turn) + square(decay));
      storage -= size * (sin(phase - turn) - decay * sin(phase));
      loss -= sign * size * (cos(phase - turn) - decay * cos(phase));
      sign = -sign;
      pole += 2;
    }
    compliance[i] = [storage, loss];
  }
  return compliance;
}

/**
 * Logarithm of the longest relaxation time tau at a temperature and grain size, s.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param temperature K
 * @param grain_size m
 */
real log_relaxation_time(vector parameter, real temperature, real grain_size) {
  return log(parameter[i_kelvin_viscosity()] / parameter[i_kelvin_modulus()])
         + log_kelvin_slowing(parameter, temperature, parameter[i_kelvin_reference_temperature()])
         + log_kelvin_coarsening(parameter, grain_size);
}

/**
 * Storage and loss compliance of the Kelvin part, 1/Pa.
 *
 * @param log_x ln(omega tau) with tau = exp(log_relaxation_time), shape (n)
 * @param parameter in the order of physics/parameters.stan; a power-law dashpot is not looked at
 * @return (n, 2)
 */
matrix kelvin_compliance(vector log_x, vector parameter) {
  int n = num_elements(log_x);
  real compliance = 1 / parameter[i_kelvin_modulus()];
  real andrade_exponent = parameter[i_andrade_exponent()];
  real log_width = log(10) * parameter[i_relaxation_time_decades()];
  matrix[n, 2] found;
  if (andrade_exponent > 0) {
    vector[n] size = compliance * tgamma(1 + andrade_exponent) * exp(-andrade_exponent * log_x);
    real angle = 0.5 * pi() * andrade_exponent;
    return append_col(cos(angle) * size, sin(angle) * size);
  }
  if (log_width > 0) {
    found = compliance * band_compliance(log_x, parameter[i_relaxation_exponent()], log_width);
  } else {
    found = compliance * element_compliance(log_x);
  }
  if (parameter[i_peak_strength()] > 0) {
    vector[n] from_peak = log_x - log(10) * parameter[i_peak_time_decades()];
    real width = parameter[i_peak_width()];
    found += parameter[i_peak_strength()] / parameter[i_maxwell_modulus()]
             * (width > 0 ? peak_compliance(from_peak, width) : element_compliance(from_peak));
  }
  return found;
}

/**
 * Part of a law that an element belongs to, in the first column of `element`: the place of the
 * parameter that switches the part on. 0 is the one element of a law without a band.
 */
int is_only_element() { return 0; }
int is_faster() { return -1; } // all times of Andrade creep below a place
int is_slower() { return -2; } // all above

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
          has_part(element, i_peak_strength())
          * max(is_free[{i_peak_strength(), i_kelvin_modulus(), i_maxwell_modulus()}]),
          is_free[i_peak_time_decades()], is_free[i_peak_width()],
          has_part(element, i_andrade_exponent())
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
    if (element[k, 1] == i_relaxation_time_decades()) {
      real below = (1 - element[k, 2]) * width;
      elements[k] = [exp(below), element[k, 3] * density * exp(-exponent * below)];
    } else if (element[k, 1] == i_peak_strength()) {
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

/**
 * Strain over the stress (1/Pa) that was put on a while ago.
 *
 * @param since that time over tau = exp(log_relaxation_time)
 * @param parameter in the order of physics/parameters.stan
 * @param element as for relaxation_elements(); Andrade creep needs none
 */
real kelvin_creep(real since, vector parameter, data matrix element) {
  matrix[rows(element), 2] elements = relaxation_elements(element, relaxation_numbers(parameter));
  if (parameter[i_andrade_exponent()] > 0) {
    return since ^ parameter[i_andrade_exponent()] / parameter[i_kelvin_modulus()];
  }
  return -dot_product(elements[ : , 2], expm1(-since * elements[ : , 1]))
         / parameter[i_kelvin_modulus()];
}

/**
 * Density of the compliance over ln(relaxation time), 1/Pa; elements of one time have none.
 *
 * @param below ln(tau/relaxation time), shape (n)
 * @param parameter in the order of physics/parameters.stan
 */
vector relaxation_density(vector below, vector parameter) {
  real compliance = 1 / parameter[i_kelvin_modulus()];
  real andrade_exponent = parameter[i_andrade_exponent()];
  real exponent = parameter[i_relaxation_exponent()];
  real log_width = log(10) * parameter[i_relaxation_time_decades()];
  real strength = parameter[i_peak_strength()] / parameter[i_maxwell_modulus()];
  real peak_width = parameter[i_peak_width()];
  vector[num_elements(below)] density = rep_vector(0, num_elements(below));
  if (andrade_exponent > 0) {
    return compliance * andrade_exponent / tgamma(1 - andrade_exponent)
           * exp(-andrade_exponent * below);
  }
  for (i in 1 : num_elements(below)) {
    if (log_width > 0 && below[i] >= 0 && below[i] <= log_width) {
      density[i] = compliance * exponent * exp(-exponent * below[i])
                   / -expm1(-exponent * log_width);
    }
    if (strength > 0 && peak_width > 0) {
      density[i] += strength
                    * exp(normal_lpdf(below[i] | log(10) * parameter[i_peak_time_decades()],
                                      peak_width));
    }
  }
  return density;
}
