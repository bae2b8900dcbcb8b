//! Nonlinear least squares against closed forms.
#![allow(clippy::unwrap_used)]

use fss_estimation::least_squares::{Fixed, Huber, Linearization, Parameter, solve};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// Standard deviation of a prior that says next to nothing.
const WIDE: f64 = 1e4;

#[test]
fn a_linear_problem_with_a_gaussian_prior_has_the_posterior_of_its_closed_form() {
    let jacobian = DMatrix::from_row_slice(4, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
    let measured = DVector::from_row_slice(&[1.1, 2.9, 5.2, 6.8]);
    let noise = [0.1_f64, 0.2, 0.3, 0.4];
    let prior = [Parameter::new(0.5, 0.2), Parameter::new(1.0, 0.5)];
    let residuals = |x: &[f64]| Some((&measured - &jacobian * DVector::from_row_slice(x)).as_slice().to_vec());
    let mut weights = Fixed(noise.iter().map(|std| 1.0 / std).collect());
    let values = solve(&prior, &[0.0, 0.0], &mut weights, &residuals).unwrap();

    let precision = DMatrix::from_diagonal(&DVector::from_iterator(4, noise.iter().map(|std| std.powi(-2))));
    let of_prior = Matrix2::from_diagonal(&Vector2::new(0.2_f64.powi(-2), 0.5_f64.powi(-2)));
    let information = jacobian.transpose() * &precision * &jacobian + of_prior;
    let right = jacobian.transpose() * &precision * &measured + of_prior * Vector2::new(0.5, 1.0);
    let covariance = information.try_inverse().unwrap();
    let mean = covariance * right;
    let linear = Linearization::at(&prior, &values, |i| 1.0 / noise[i], &residuals).unwrap();
    for j in 0..2 {
        assert!((values[j] - mean[j]).abs() < 1e-8, "{values:?} against {mean}");
        let variance = linear.parameter_variance(j) * prior[j].std.powi(2);
        assert!((variance / covariance[(j, j)] - 1.0).abs() < 1e-6, "{variance} against {covariance}");
    }
    assert_eq!(linear.rank(), 2);
}

#[test]
fn a_parameter_stops_at_its_bound_and_the_others_take_the_best_values_given_it() {
    // Free, the line through these points has intercept 1 and slope 2.
    let t = [0.0, 1.0, 2.0, 3.0];
    let residuals = |x: &[f64]| Some(t.iter().map(|t| 1.0 + 2.0 * t - x[0] - x[1] * t).collect());
    let wide = Parameter::new(0.0, WIDE);
    let bounded = [wide, wide.within(0.0, 1.5)];
    let values = solve(&bounded, &[0.0, 0.0], &mut Fixed(vec![1.0; 4]), &residuals).unwrap();
    // With slope b the best intercept is the mean of measured less b t: 1 + (2 - b) 1.5.
    assert!(values[1] <= 1.5 && (values[1] - 1.5).abs() < 1e-9, "{values:?}");
    assert!((values[0] - 1.75).abs() < 1e-6, "{values:?}");
    // From a bound it comes back where that is better.
    let inside = [wide, wide.within(0.0, 3.0)];
    let values = solve(&inside, &[0.0, 3.0], &mut Fixed(vec![1.0; 4]), &residuals).unwrap();
    assert!((values[0] - 1.0).abs() < 1e-6 && (values[1] - 2.0).abs() < 1e-6, "{values:?}");
}

#[test]
fn a_parameter_at_a_bound_needs_no_residuals_beyond_it() {
    // The data ask for 2; beyond 1 there are none.
    let residuals = |x: &[f64]| (x[0] <= 1.0).then(|| vec![2.0 - x[0], 2.0 - x[0]]);
    let parameter = Parameter::new(0.0, WIDE).within(-1.0, 1.0);
    let values = solve(&[parameter], &[0.0], &mut Fixed(vec![1.0; 2]), &residuals).unwrap();
    assert!((values[0] - 1.0).abs() < 1e-12, "{values:?}");
}

#[test]
fn hubers_weights_let_an_outlier_pull_a_mean_no_further_than_the_threshold() {
    // Ten samples of 3 and one far off: a sum of clipped residuals of 0 gives 10 (m - 3) = threshold.
    let mut samples = vec![3.0; 10];
    samples.push(1000.0);
    let residuals = |x: &[f64]| Some(samples.iter().map(|sample| sample - x[0]).collect());
    let mut weights = Huber::new(vec![1.0; 11], 1.345);
    let values = solve(&[Parameter::new(0.0, WIDE)], &[0.0], &mut weights, &residuals).unwrap();
    assert!((values[0] - 3.1345).abs() < 1e-6, "{values:?}");
}

#[test]
fn a_decay_without_noise_gives_back_its_parameters() {
    let truth = [2.0, 0.7, 0.3];
    let curve = |x: &[f64], t: f64| x[0] * (-x[1] * t).exp() + x[2];
    let times: Vec<f64> = (0..40).map(|k| 0.2 * f64::from(k)).collect();
    let residuals = |x: &[f64]| Some(times.iter().map(|t| curve(&truth, *t) - curve(x, *t)).collect());
    let start = [1.0, 1.0, 0.0];
    let prior = start.map(|mean| Parameter::new(mean, 100.0));
    let values = solve(&prior, &start, &mut Fixed(vec![100.0; 40]), &residuals).unwrap();
    for (value, truth) in values.iter().zip(truth) {
        assert!((value - truth).abs() < 1e-6, "{values:?}");
    }
}

#[test]
fn a_step_to_impossible_values_is_shortened() {
    // The first step from 4 for log(x) = 0 leads to a negative x.
    let residuals = |x: &[f64]| (x[0] > 0.0).then(|| vec![-x[0].ln()]);
    let values = solve(&[Parameter::new(1.0, 10.0)], &[4.0], &mut Fixed(vec![1e3]), &residuals).unwrap();
    assert!((values[0] - 1.0).abs() < 1e-6, "{values:?}");
}

#[test]
fn a_direction_that_the_data_do_not_determine_stays_at_the_prior() {
    let residuals = |x: &[f64]| Some(vec![3.0 - x[0] - x[1]; 5]);
    let prior = [Parameter::new(1.0, 1.0), Parameter::new(0.0, 1.0)];
    let values = solve(&prior, &[0.0, 0.0], &mut Fixed(vec![1e3; 5]), &residuals).unwrap();
    // The nearest point to (1, 0) on the line x + y = 3.
    assert!((values[0] - 2.0).abs() < 1e-6 && (values[1] - 1.0).abs() < 1e-6, "{values:?}");
    let linear = Linearization::at(&prior, &values, |_| 1e3, &residuals).unwrap();
    assert_eq!(linear.rank(), 1);
}
