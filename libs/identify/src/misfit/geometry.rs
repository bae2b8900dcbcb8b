//! What the geometry's stated uncertainty explains of the end-effector's error.
//!
//! The plant file says how well it knows lengths, joint offsets and the place of joint 1. The end-effector's error is linear
//! in their small corrections, so these are estimated with the stated standard deviations as a prior (regularised least
//! squares), and what they explain is no misfit.

use fss_multibody::{Coordinates, Model, Parameter};
use fss_plant::Plant;
use nalgebra::{DMatrix, DVector, Vector3};

/// Errors of the end-effector's pose, and what geometry could have to do with them.
pub(super) struct Geometry {
    parameters: Vec<Parameter>,
    /// Inverse of the prior covariance, plus what the samples say, in units of each prior's standard deviation.
    normal: DMatrix<f64>,
    right: DVector<f64>,
    prior_sd: Vec<f64>,
    samples: Vec<Sample>,
}

struct Sample {
    t_s: f64,
    error: Vector3<f64>,
    variance: Vector3<f64>,
    /// Derivatives of the pose, one column a parameter, each times its prior standard deviation.
    columns: Vec<Vector3<f64>>,
}

impl Geometry {
    pub(super) fn new(plant: &Plant) -> Self {
        let mut parameters = Vec::new();
        let mut prior_sd = Vec::new();
        if let Some(u) = &plant.uncertainty {
            let mut add = |parameter, sd: f64| {
                if sd > 0.0 {
                    parameters.push(parameter);
                    prior_sd.push(sd);
                }
            };
            add(Parameter::Joint1X, u.joint1_xy_m);
            add(Parameter::Joint1Y, u.joint1_xy_m);
            add(Parameter::Joint1Angle, u.joint1_angle_rad);
            for link in 1..=plant.link_count() {
                add(Parameter::LinkLength(link), u.link_length_m);
                add(Parameter::JointOffset(link), u.joint_offset_rad);
            }
        }
        let n = parameters.len();
        let (normal, right) = (DMatrix::identity(n, n), DVector::zeros(n));
        Self { parameters, normal, right, prior_sd, samples: Vec::new() }
    }

    /// Takes measured less simulated pose of the end-effector at a configuration, and its noise variance.
    pub(super) fn add(&mut self, model: &Model, q: &Coordinates, t_s: f64, error: [f64; 3], variance: [f64; 3]) {
        let (error, variance) = (Vector3::from(error), Vector3::from(variance));
        let weight = variance.map(|v| if v > 0.0 { 1.0 / v } else { 0.0 });
        let column = |(p, sd): (&Parameter, &f64)| model.end_effector_by_parameter(q, *p) * *sd;
        let columns: Vec<Vector3<f64>> = self.parameters.iter().zip(&self.prior_sd).map(column).collect();
        for (i, a) in columns.iter().enumerate() {
            let weighted = a.component_mul(&weight);
            self.right[i] += weighted.dot(&error);
            for (j, b) in columns.iter().enumerate() {
                self.normal[(i, j)] += weighted.dot(b);
            }
        }
        self.samples.push(Sample { t_s, error, variance, columns });
    }

    /// Time, error that the corrections leave, and noise variance of each sample.
    pub(super) fn unexplained(self) -> impl Iterator<Item = (f64, Vector3<f64>, Vector3<f64>)> {
        let n = self.parameters.len();
        let correction = self.normal.cholesky().map_or_else(|| DVector::zeros(n), |factor| factor.solve(&self.right));
        self.samples.into_iter().map(move |s| {
            let explained: Vector3<f64> = s.columns.iter().zip(correction.iter()).map(|(c, p)| c * *p).sum();
            (s.t_s, s.error - explained, s.variance)
        })
    }
}
