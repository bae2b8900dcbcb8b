//! A step of the base's filter, assembled from what each force does in it.

use super::noise_model::FORCES;
use fss_estimation::Step;
use fss_estimation::processes::SingerStep;

/// A step on its way to being complete.
#[derive(Default)]
pub(super) struct Assembled {
    pub(super) step: Step,
    /// Noise of the body's motion, to which every force adds.
    pub(super) body: [[f64; FORCES]; FORCES],
}

impl Assembled {
    /// Nothing in it.
    pub(super) fn clear(&mut self) {
        self.step.clear();
        self.body = [[0.0; FORCES]; FORCES];
    }

    /// Adds `variance B S B'` to the noise, `B` given by rows.
    pub(super) fn add_noise(&mut self, onto: &[(usize, [f64; 3])], s: &[[f64; 3]; 3], variance: f64) {
        let acts = |(_, b): &&(usize, [f64; 3])| *b != [0.0; 3];
        for (i, b) in onto.iter().filter(acts) {
            let through: [f64; 3] =
                std::array::from_fn(|l| variance * (b[0] * s[0][l] + b[1] * s[1][l] + b[2] * s[2][l]));
            for (j, b) in onto.iter().filter(acts) {
                let value = through[0] * b[0] + through[1] * b[1] + through[2] * b[2];
                if *i < FORCES && *j < FORCES {
                    self.body[*i][*j] += value;
                } else {
                    self.step.noise.push((*i, *j, value));
                }
            }
        }
    }

    /// Adds a force that is a state of this variance: along x and y and its moment about the centre of mass at 1, and what it does in
    /// the step to the two translations and to the heading.
    pub(super) fn add_force(
        &mut self,
        (state, [fx, fy, torque], variance): (usize, [f64; 3], f64),
        singer: &SingerStep,
        (mass, inertia): (f64, f64),
    ) {
        let onto = [
            (0, [fx / mass, 0.0, 0.0]),
            (1, [0.0, fx / mass, 0.0]),
            (2, [fy / mass, 0.0, 0.0]),
            (3, [0.0, fy / mass, 0.0]),
            (4, [torque / inertia, 0.0, 0.0]),
            (5, [0.0, torque, 0.0]),
            (state, [0.0, 0.0, 1.0]),
        ];
        let moves = onto[..FORCES].iter().map(|(row, [p, v, _])| (*row, p * singer.position + v * singer.velocity));
        let transition = &mut self.step.transition;
        transition.extend(moves.filter(|(_, by)| *by != 0.0).map(|(row, by)| (row, state, by)));
        transition.push((state, state, singer.decay));
        self.add_noise(&onto, &singer.noise, variance);
    }

    /// With the noise of the body's motion.
    pub(super) fn complete(&mut self) -> &Step {
        for (i, row) in self.body.iter().enumerate() {
            self.step.noise.extend(row.iter().enumerate().filter(|(_, q)| **q != 0.0).map(|(j, q)| (i, j, *q)));
        }
        &self.step
    }
}
