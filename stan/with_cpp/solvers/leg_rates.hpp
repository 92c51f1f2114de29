#ifndef BURGERS_LEG_RATES_HPP
#define BURGERS_LEG_RATES_HPP
/**
 * Rates of the Burgers model along a leg, and their derivatives, for radau.hpp.
 *
 * The equations are those of kinds/loading_history_rates.stan and kinds/loading_history_legs.stan,
 * whose symbols and units are used here; a test compares both.
 *
 * Every part of the rates is a structure of its value and its partial derivatives. pull_back() of
 * the rates applies them in reverse.
 */
#include "radau.hpp"
#include <stan/math.hpp>
#include <cmath>
#include <vector>

namespace burgers {

/** Places of the arguments that have derivatives; the first are the h_NAME() of Stan, from 0. */
enum Argument {
  log_dashpot_rate,
  stress_exponent,
  grain_size_exponent,
  kelvin_decay,     // of a power-law Kelvin element
  kelvin_compliance,
  spring_compliance,
  apparatus_compliance,
  grain_size_deficit,
  grain_size_decay,
  fabric_deficit,
  fabric_decay,
  kelvin_exponent,  // n_K of a power-law Kelvin element
  dashpot_stress,   // of another law than the power law, over S
  log_kelvin_unit,  // ln(S/q_0)
  stress_scale,     // S, Pa
  start_path,       // g at the start; where strain only grows, less what the load has stretched
  hardening,        // H e/S
  backstress_limit, // sigma_max/S
  recovery,         // D r
  recovery_exponent,
  source_stress,      // sigma_d/S at d_0
  boundary_recovery,  // c_r
  reference_backstress, // sigma_0/S; 0: the backstress is not that of dislocations
  log_further_rate, // ln v_k0 of the second mechanism; from here on given where there is one
  further_stress_exponent,
  further_grain_size_exponent,
  n_arguments = log_further_rate + 6 // the same of the third
};

/** What drives a leg: the first entry of its laws. */
enum Driven { by_strain, by_stress, by_force, by_oscillation };

/** Laws of the dashpot and of the Kelvin element. */
enum DashpotLaw { power_law, breakdown, threshold };
enum KelvinLaw { linear, kelvin_power_law };

/** How mechanisms of the dashpot act: the least numbers with a third one beside, in series. */
enum Mechanisms { one_mechanism, third_beside = 4, third_in_series = 7, last_mechanisms };

/**
 * A strain that oscillates about a background: its rate is linear in amplitudes, which are arguments
 * (oscillating_rate() of kinds/forced_oscillation_dynamics.stan).
 */
struct Oscillation {
  int n_harmonics = 0, n_background = 0;
  int first_amplitude = 0; // among the arguments
  double start = 0, record = 0, middle = 0, half = 1; // in periods

  int n_amplitudes() const { return 2 * n_harmonics + n_background; }

  /** Call f with the place and the derivative of each amplitude at a time since the start. */
  template <class Function>
  void each(double t, const Function &f) const {
    const double tau = start + t;
    for (int k = 0; k < n_harmonics; ++k) {
      const double frequency = 2 * stan::math::pi() * (k + 1);
      f(first_amplitude + k, frequency * std::cos(frequency * tau));
      f(first_amplitude + n_harmonics + k, -frequency * std::sin(frequency * tau));
    }
    const double place = (std::max(tau, record) - middle) / half;
    double power = 1;
    for (int k = 2 * n_harmonics; k < n_amplitudes(); ++k) {
      f(first_amplitude + k, power);
      power *= place;
    }
  }
};

/** The laws and states of a leg, and the numbers that are data. */
struct Leg {
  int driven;
  int dashpot_law, kelvin_law;
  int g, u, b; // places among the states, -1: no state
  int z; // that of a power-law Kelvin element is the last state
  int mechanisms;
  double y_0;  // y or f at the start
  double rate; // r
  double strain_scale;
  double piezometer, piezometer_exponent, piezometer_floor; // d_1/d_0, m, Pa
  Oscillation oscillation;
  bool grains_grow; // not ahead of the record of an oscillation
  int n_elements, n_states;

  /** The entries are in the order above; numbers of all states and of all arguments. */
  Leg(const std::vector<int> &law, const std::vector<double> &known, int n_all, int n_given)
      : driven(law[0]), dashpot_law(law[1]), kelvin_law(law[2]), g(law[3]), u(law[4]), b(law[5]),
        mechanisms(law[6]), y_0(known[0]), rate(known[1]), strain_scale(known[2]),
        piezometer(known[3]), piezometer_exponent(known[4]), piezometer_floor(known[5]),
        grains_grow(true) {
    if (driven == by_oscillation) {
      driven = by_strain;
      oscillation = {law[7], law[8], 0, known[6], known[7], known[8], known[9]};
      oscillation.first_amplitude = n_given - oscillation.n_amplitudes();
      grains_grow = oscillation.start >= oscillation.record;
    }
    n_elements = (n_given - oscillation.n_amplitudes() - n_arguments) / 2;
    n_states = n_all - n_elements;
    z = kelvin_law == linear ? -1 : n_states - 1;
  }

  /** Whether these laws are known here. */
  bool is_known() const {
    return dashpot_law <= threshold && kelvin_law <= kelvin_power_law && mechanisms <= last_mechanisms;
  }

  /** Whether g is known from the time. */
  bool path_is_known() const { return driven == by_strain && g < 0; }

  /** Whether the backstress is that of dislocations. */
  bool has_dislocations(const double *x) const { return b >= 0 && x[reference_backstress] > 0; }

  /** Whether g follows from the strains, which only grow. */
  bool strain_grows() const { return driven == by_stress && g < 0; }
};

/** ln of a microstructural variable relative to its initial value. */
struct Relative {
  double log, by_path, by_deficit, by_decay;

  void set(double path, double deficit, double decay) {
    if (path < 0) {
      log = by_path = by_deficit = by_decay = 0;
      return;
    }
    const double gone = std::expm1(-path * decay);
    const double value = 1 + deficit * gone;
    const double slope = -deficit * (1 + gone) / value;
    log = std::log1p(deficit * gone);
    by_path = slope * decay;
    by_decay = slope * path;
    by_deficit = gone / value;
  }
};

/** Rate of the dashpot, v_d, or of its first mechanism, v_1. */
struct Flow {
  double rate;
  double log_strength; // ln(|equivalent stress|/F)
  double by_stress, by_log_fabric, by_law_stress;

  /** `density` is that of dislocations over the one at sigma_0, or 1. */
  void set(double y, double log_fabric, double log_grain_size, double density, int law,
           const double *x) {
    const double n = x[stress_exponent];
    double strength_by_stress, strength_by_fabric = -1, strength_by_law_stress = 0;
    double s = y;
    if (law == threshold) {
      s = y > x[dashpot_stress] ? y - x[dashpot_stress]
                                : (y < -x[dashpot_stress] ? y + x[dashpot_stress] : 0);
    }
    rate = log_strength = by_stress = by_log_fabric = by_law_stress = 0;
    if (s == 0) {
      return;
    }
    if (law == breakdown) {
      const double unit = std::exp(log_fabric) * x[dashpot_stress];
      const double largest = 650 / std::max(n, 1.0);
      const double over = std::min(std::fabs(y) / unit, largest);
      log_strength = std::log(x[dashpot_stress] * std::sinh(over));
      const double cotangent = over < largest ? 1 / std::tanh(over) : 0;
      strength_by_stress = (y < 0 ? -cotangent : cotangent) / unit;
      strength_by_fabric = -over * cotangent;
      strength_by_law_stress = (1 - over * cotangent) / x[dashpot_stress];
    } else {
      log_strength = std::log(std::fabs(s)) - log_fabric;
      strength_by_stress = 1 / s;
      strength_by_law_stress = law == threshold ? -1 / std::fabs(s) : 0;
    }
    rate = density
           * std::exp(n * log_strength + x[log_dashpot_rate]
                      - x[grain_size_exponent] * log_grain_size);
    rate = s < 0 ? -rate : rate;
    by_stress = rate * n * strength_by_stress;
    by_log_fabric = rate * n * strength_by_fabric;
    by_law_stress = rate * n * strength_by_law_stress;
  }
};

/** Rate of two mechanisms, side by side or in series, with rates of one sign. */
struct Pair {
  double rate, by_first, by_second;

  Pair(double first, double second, bool in_series)
      : rate(first + second), by_first(1), by_second(1) {
    if (in_series && (first == 0 || second == 0)) {
      rate = by_first = by_second = 0;
    } else if (in_series) {
      const double share = 1 / (1 + first / second); // of the rate in the first
      rate = share > 0.5 ? first * share : second * (1 - share);
      by_first = share * share;
      by_second = (1 - share) * (1 - share);
    }
  }
};

/** A further mechanism, v_k, and the derivative of v_d by it. */
struct Further {
  double rate, by_stress, of_dashpot;
};

/** Rate of the dashpot, v_d, of all mechanisms. */
struct Mechanism {
  double rate, by_first, log_stress;
  int n_further;
  Further further[2];

  void set(double first, double y, double log_grain_size, int mechanisms, const double *x) {
    rate = first;
    by_first = 1;
    log_stress = y != 0 ? std::log(std::fabs(y)) : 0;
    n_further = mechanisms >= third_beside ? 2 : (mechanisms > one_mechanism ? 1 : 0);
    if (n_further == 0) {
      return;
    }
    for (int k = 0; k < n_further; ++k) {
      const double *own = x + 3 * k;
      further[k] = {0, 0, 1};
      if (y != 0) {
        const double magnitude
            = std::exp(own[further_stress_exponent] * log_stress + own[log_further_rate]
                       - own[further_grain_size_exponent] * log_grain_size);
        further[k].rate = y < 0 ? -magnitude : magnitude;
        further[k].by_stress = own[further_stress_exponent] * magnitude / std::fabs(y);
      }
    }
    double partner = further[0].rate;
    if (mechanisms >= third_in_series) {
      const Pair pair(further[0].rate, further[1].rate, true);
      partner = pair.rate;
      further[0].of_dashpot = pair.by_first;
      further[1].of_dashpot = pair.by_second;
    }
    const Pair pair(first, partner, mechanisms % 3 == 2);
    rate = pair.rate;
    by_first = pair.by_first;
    further[0].of_dashpot *= pair.by_second;
    if (mechanisms >= third_in_series) {
      further[1].of_dashpot *= pair.by_second;
    } else if (n_further == 2) {
      rate += further[1].rate;
    }
  }
};

/** db/dt of the backstress. */
struct Backstress {
  double rate, by_flow, by_backstress, by_hardening, by_limit, by_recovery, by_exponent;
  double by_source, by_boundary, by_reference;

  /** `source` is the stress of the sources of dislocations. */
  void set(double b, double flow_rate, double source, bool has_dislocations, const double *x) {
    const double limit = x[backstress_limit];
    const double unit = has_dislocations ? x[reference_backstress] : limit;
    const double sources = has_dislocations ? source / b : 0;
    const double stored = flow_rate * (1 + sources) - std::fabs(flow_rate) * b / limit;
    // r sgn(b) |b/unit|^m, and its part |b/unit|^(m - 1) at any b
    const double ratio = std::fabs(b) / unit;
    const double slower = std::pow(ratio, x[recovery_exponent] - 1);
    const double share = b / unit * slower;
    const double recovery_slope = x[recovery] * x[recovery_exponent] * slower;
    const double cube = has_dislocations ? std::pow(b / unit, 3) : 0;
    const double by_boundaries = x[boundary_recovery] * source * cube; // over r
    rate = x[hardening] * stored - x[recovery] * (unit * share + by_boundaries);
    by_flow = x[hardening] * (1 + sources - (flow_rate < 0 ? -b : b) / limit);
    by_backstress = -x[hardening] * std::fabs(flow_rate) / limit - recovery_slope;
    by_hardening = stored;
    by_limit = x[hardening] * std::fabs(flow_rate) * b / (limit * limit);
    by_recovery = -unit * share - by_boundaries;
    by_exponent = ratio > 0 ? -unit * x[recovery] * share * std::log(ratio) : 0;
    by_source = by_boundary = 0;
    by_reference = recovery_slope * b / unit - x[recovery] * share; // by the unit
    if (has_dislocations) {
      by_backstress -= (x[hardening] * flow_rate * sources + 3 * x[recovery] * by_boundaries) / b;
      by_source = x[hardening] * flow_rate / b - x[recovery] * x[boundary_recovery] * cube;
      by_boundary = -x[recovery] * source * cube;
      by_reference += 3 * x[recovery] * by_boundaries / unit;
    } else {
      by_limit += by_reference;
    }
  }
};

/** dz/dt of a power-law Kelvin element under the driving stress q. */
struct Kelvin {
  double rate, by_stress, by_decay, by_exponent, by_log_unit;

  void set(double q, const double *x) {
    const double decay = x[kelvin_decay];
    by_decay = q;
    by_stress = decay;
    by_exponent = by_log_unit = 0;
    if (q != 0) {
      const double exponent = x[kelvin_exponent];
      const double log_ratio = std::log(std::fabs(q)) + x[log_kelvin_unit];
      by_decay = q * std::exp((exponent - 1) * log_ratio);
      by_stress = decay * by_decay / q * exponent;
      by_exponent = decay * by_decay * log_ratio;
      by_log_unit = decay * by_decay * (exponent - 1);
    }
    rate = decay * by_decay;
  }
};

/** Grain size that the piezometer wants, over d_0. */
struct Piezometer {
  double value, by_stress, by_scale;

  void set(double y, double scale, const Leg &leg) {
    const double stress = 1e-6 * scale * y;
    const double floor = 1e-6 * leg.piezometer_floor;
    const double square = stress * stress + floor * floor;
    value = leg.piezometer * std::exp(-0.5 * leg.piezometer_exponent * std::log(square));
    const double by_megapascals = -leg.piezometer_exponent * value * stress / square;
    by_stress = by_megapascals * 1e-6 * scale;
    by_scale = by_megapascals * 1e-6 * y;
  }
};

/** Rates of a leg with N states, in the order of kinds/loading_history_legs.stan. */
template <int N>
class LegRates {
 public:
  static constexpr int n_states = N;

  struct Point {
    double t, state[N], rate[N];
    double imposed_rate;
    double y, y_slope, z, z_rate, path, u, b, area, finer, source;
    double path_rate, sign, denominator;
    Relative fabric, grains;
    Flow flow;
    Mechanism dashpot;
    Kelvin kelvin;
    Backstress backstress;
    Piezometer wanted;
  };

  /** The arguments are not copied. */
  LegRates(const Leg &leg, const double *arguments) : leg_(leg), x_(arguments) {}

  void prepare(Point &p) const {
    p.u = 1;
    p.b = 0;
    p.area = 1;
    p.imposed_rate = leg_.rate;
    leg_.oscillation.each(p.t, [&](int k, double slope) { p.imposed_rate += x_[k] * slope; });
    if (leg_.path_is_known()) {
      p.path = x_[start_path] + std::fabs(leg_.rate) * p.t;
      set_microstructure(p);
    }
  }

  void drive(Point &p) const {
    p.y_slope = 0;
    if (leg_.driven == by_strain) {
      p.y = p.state[0];
      p.y_slope = 1;
    } else {
      p.y = leg_.y_0 + leg_.rate * p.t;
      if (leg_.driven == by_force) {
        p.area = std::exp(-leg_.strain_scale * p.state[0]);
        p.y *= p.area;
        p.y_slope = -leg_.strain_scale * p.y;
      }
    }
  }

  void evaluate(Point &p) const {
    if (leg_.z >= 0) {
      p.kelvin.set(p.y - p.state[leg_.z], x_);
      p.z_rate = p.kelvin.rate;
    }
    if (leg_.b >= 0) {
      p.b = p.state[leg_.b];
    }
    if (leg_.u >= 0) {
      p.u = p.state[leg_.u];
      p.wanted.set(p.y, x_[stress_scale], leg_);
    }
    if (!leg_.path_is_known()) {
      p.path = x_[start_path];
      p.path += leg_.strain_grows() ? x_[spring_compliance] * p.y + x_[kelvin_compliance] * p.z
                                          + p.state[0]
                                    : p.state[leg_.g];
      set_microstructure(p);
    }
    const double log_grain_size = leg_.u >= 0 ? std::log(p.u) : p.grains.log;
    double density = 1;
    p.source = 0;
    if (leg_.has_dislocations(x_)) {
      p.finer = std::exp(-log_grain_size);
      p.source = x_[source_stress] * p.finer;
      density = std::pow(p.b / x_[reference_backstress], 2);
    }
    p.flow.set(p.y - p.b - p.source, p.fabric.log, log_grain_size, density, leg_.dashpot_law, x_);
    p.dashpot.set(p.flow.rate, p.y, log_grain_size, leg_.mechanisms, x_);
    const double inelastic = x_[kelvin_compliance] * p.z_rate + p.dashpot.rate;
    double strain_rate;
    if (leg_.driven == by_strain) {
      p.denominator = x_[spring_compliance] + x_[apparatus_compliance];
      p.rate[0] = (p.imposed_rate - inelastic) / p.denominator;
      strain_rate = p.imposed_rate - x_[apparatus_compliance] * p.rate[0];
    } else if (leg_.driven == by_stress) {
      p.rate[0] = p.dashpot.rate;
      strain_rate = x_[spring_compliance] * leg_.rate + inelastic;
    } else {
      p.denominator = 1 + leg_.strain_scale * x_[spring_compliance] * p.y;
      p.rate[0] = (x_[spring_compliance] * leg_.rate * p.area + inelastic) / p.denominator;
      strain_rate = p.rate[0];
    }
    p.sign = strain_rate < 0 ? -1 : (strain_rate > 0 ? 1 : 0);
    p.sign *= leg_.grains_grow;
    p.path_rate = p.sign * strain_rate;
    if (leg_.z >= 0) {
      p.rate[leg_.z] = p.z_rate;
    }
    if (leg_.g >= 0) {
      p.rate[leg_.g] = p.path_rate;
    }
    if (leg_.b >= 0) {
      p.backstress.set(p.b, p.flow.rate, p.source, leg_.has_dislocations(x_), x_);
      p.rate[leg_.b] = p.backstress.rate;
    }
    if (leg_.u >= 0) {
      p.rate[leg_.u] = p.path_rate * x_[grain_size_decay] * (p.wanted.value - p.u);
    }
  }

  template <bool args>
  void pull_back(const Point &p, const double *by_rate, Adjoint<N> &adjoint, double *by_x) const {
    double *by_state = adjoint.state;
    double y = 0, u = 0, area = 0; // adjoints
    double kelvin_rate = leg_.z >= 0 ? by_rate[leg_.z] : 0;
    double path_rate = leg_.g >= 0 ? by_rate[leg_.g] : 0;
    if (leg_.u >= 0) {
      const double growth = by_rate[leg_.u] * x_[grain_size_decay];
      path_rate += growth * (p.wanted.value - p.u);
      y += growth * p.path_rate * p.wanted.by_stress;
      u -= growth * p.path_rate;
      if (args) {
        by_x[grain_size_decay] += by_rate[leg_.u] * p.path_rate * (p.wanted.value - p.u);
        by_x[stress_scale] += growth * p.path_rate * p.wanted.by_scale;
      }
    }
    double inelastic, flow_rate; // of kelvin_compliance * kelvin_rate + flow rate
    const double strain_rate = p.sign * path_rate;
    if (leg_.driven == by_strain) {
      const double scaled
          = (by_rate[0] - strain_rate * x_[apparatus_compliance]) / p.denominator;
      inelastic = flow_rate = -scaled;
      if (args) {
        by_x[spring_compliance] -= scaled * p.rate[0];
        by_x[apparatus_compliance] -= (scaled + strain_rate) * p.rate[0];
        leg_.oscillation.each(
            p.t, [&](int k, double slope) { by_x[k] += (scaled + strain_rate) * slope; });
      }
    } else if (leg_.driven == by_stress) {
      inelastic = strain_rate;
      flow_rate = strain_rate + by_rate[0];
      if (args) {
        by_x[spring_compliance] += strain_rate * leg_.rate;
      }
    } else {
      const double scaled = (by_rate[0] + strain_rate) / p.denominator;
      inelastic = flow_rate = scaled;
      y -= scaled * leg_.strain_scale * x_[spring_compliance] * p.rate[0];
      area += scaled * x_[spring_compliance] * leg_.rate;
      if (args) {
        by_x[spring_compliance]
            += scaled * (leg_.rate * p.area - leg_.strain_scale * p.y * p.rate[0]);
      }
    }
    kelvin_rate += inelastic * x_[kelvin_compliance];
    double further_rate[2]; // v_k times its adjoint
    double log_grain_size = 0;
    for (int k = 0; k < p.dashpot.n_further; ++k) {
      const Further &own = p.dashpot.further[k];
      further_rate[k] = flow_rate * own.of_dashpot * own.rate;
      y += flow_rate * own.of_dashpot * own.by_stress;
      log_grain_size -= further_rate[k] * x_[further_grain_size_exponent + 3 * k];
    }
    flow_rate *= p.dashpot.by_first; // of the first mechanism from here on
    if (leg_.b >= 0) {
      const double storage = by_rate[leg_.b];
      flow_rate += storage * p.backstress.by_flow;
      by_state[leg_.b] += storage * p.backstress.by_backstress - flow_rate * p.flow.by_stress;
      if (args) {
        by_x[hardening] += storage * p.backstress.by_hardening;
        by_x[backstress_limit] += storage * p.backstress.by_limit;
        by_x[recovery] += storage * p.backstress.by_recovery;
        by_x[recovery_exponent] += storage * p.backstress.by_exponent;
      }
      if (leg_.has_dislocations(x_)) {
        const double by_source
            = storage * p.backstress.by_source - flow_rate * p.flow.by_stress;
        by_state[leg_.b] += 2 * flow_rate * p.flow.rate / p.b;
        log_grain_size -= by_source * p.source;
        if (args) {
          by_x[source_stress] += by_source * p.finer;
          by_x[boundary_recovery] += storage * p.backstress.by_boundary;
          by_x[reference_backstress]
              += storage * p.backstress.by_reference
                 - 2 * flow_rate * p.flow.rate / x_[reference_backstress];
        }
      }
    }
    const double log_fabric = flow_rate * p.flow.by_log_fabric;
    log_grain_size -= flow_rate * p.flow.rate * x_[grain_size_exponent];
    double path = log_fabric * p.fabric.by_path;
    y += flow_rate * p.flow.by_stress;
    if (leg_.z >= 0) {
      y += kelvin_rate * p.kelvin.by_stress;
      by_state[leg_.z] -= kelvin_rate * p.kelvin.by_stress;
      if (args) {
        by_x[kelvin_decay] += kelvin_rate * p.kelvin.by_decay;
        by_x[kelvin_exponent] += kelvin_rate * p.kelvin.by_exponent;
        by_x[log_kelvin_unit] += kelvin_rate * p.kelvin.by_log_unit;
      }
    } else {
      adjoint.z_rate += kelvin_rate;
    }
    if (leg_.u >= 0) {
      u += log_grain_size / p.u;
    } else {
      path += log_grain_size * p.grains.by_path;
    }
    if (args) {
      by_x[kelvin_compliance] += inelastic * p.z_rate;
      by_x[log_dashpot_rate] += flow_rate * p.flow.rate;
      by_x[stress_exponent] += flow_rate * p.flow.rate * p.flow.log_strength;
      const double log_coarser = leg_.u >= 0 ? std::log(p.u) : p.grains.log;
      by_x[grain_size_exponent] -= flow_rate * p.flow.rate * log_coarser;
      by_x[dashpot_stress] += flow_rate * p.flow.by_law_stress;
      for (int k = 0; k < p.dashpot.n_further; ++k) {
        by_x[log_further_rate + 3 * k] += further_rate[k];
        by_x[further_stress_exponent + 3 * k] += further_rate[k] * p.dashpot.log_stress;
        by_x[further_grain_size_exponent + 3 * k] -= further_rate[k] * log_coarser;
      }
      by_x[fabric_deficit] += log_fabric * p.fabric.by_deficit;
      by_x[fabric_decay] += log_fabric * p.fabric.by_decay;
      if (leg_.u < 0) {
        by_x[grain_size_deficit] += log_grain_size * p.grains.by_deficit;
        by_x[grain_size_decay] += log_grain_size * p.grains.by_decay;
      }
      by_x[start_path] += path;
    }
    if (leg_.strain_grows()) {
      by_state[0] += path;
      adjoint.z += path * x_[kelvin_compliance];
      if (args) {
        by_x[spring_compliance] += path * p.y;
        by_x[kelvin_compliance] += path * p.z;
      }
    } else if (leg_.g >= 0) {
      by_state[leg_.g] += path;
    }
    if (leg_.u >= 0) {
      by_state[leg_.u] += u;
    }
    if (leg_.driven == by_strain) {
      by_state[0] += y;
    } else if (leg_.driven == by_force) {
      by_state[0] -= leg_.strain_scale * (y * p.y + area * p.area);
    }
  }

 private:
  Leg leg_;
  const double *x_;

  void set_microstructure(Point &p) const {
    p.fabric.set(p.path, x_[fabric_deficit], x_[fabric_decay]);
    if (leg_.u < 0) {
      p.grains.set(p.path, x_[grain_size_deficit], x_[grain_size_decay]);
    }
  }
};

}  // namespace burgers
#endif
