//! Which way a joint slides, as far as its rate is known.

/// Rates below about this are not told from rest, rad/s: a gear's teeth and a driver's dither move a joint at rest so fast.
const REST_RAD_S: f64 = 0.006;

/// The direction of sliding, -1 to 1, that is expected of a rate known to the standard deviation `sd`: the hyperbolic tangent
/// that is closest to the normal distribution's integral.
pub(crate) fn direction(rate_rad_s: f64, sd_rad_s: f64) -> f64 {
    (rate_rad_s / (sd_rad_s.hypot(REST_RAD_S) * 1.25)).tanh()
}
