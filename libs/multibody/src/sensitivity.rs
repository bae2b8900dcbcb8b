//! Steps that carry along how their result depends on where they started, on forces and on parameters.

use crate::chain::by_bodies;
use crate::derivatives::Linearized;
use crate::{Coordinates, MassMatrix, Model, Parameter, State};

/// Generalized forces as a law of time and state, with what is known of their derivatives.
///
/// Every function of time (s, from the step's start) and state is one, taken as independent of the state: right for
/// forces held over a step.
pub trait ForceLaw {
    /// Generalized forces.
    fn forces(&self, time_s: f64, state: &State) -> Coordinates;

    /// Derivatives of the forces with respect to coordinates and velocities, rows forces; none for zero.
    fn gradient(&self, _time_s: f64, _state: &State) -> Option<ForceGradient> {
        None
    }

    /// Derivative of the forces with respect to the law's own parameter number `index`.
    fn by_parameter(&self, _time_s: f64, _state: &State, _index: usize) -> Coordinates {
        Coordinates::zeros()
    }
}

impl<F: Fn(f64, &State) -> Coordinates> ForceLaw for F {
    fn forces(&self, time_s: f64, state: &State) -> Coordinates {
        self(time_s, state)
    }
}

/// Derivatives of generalized forces, rows forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceGradient {
    /// With respect to the coordinates.
    pub by_q: MassMatrix,
    /// With respect to the velocities.
    pub by_v: MassMatrix,
}

/// What a [`Sensitivity`] is taken with respect to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Something of the past: only the tangent given carries it on.
    Start,
    /// A constant force added to generalized force number `.0` (0 = Fx).
    Force(usize),
    /// A number of the mechanism.
    Parameter(Parameter),
    /// A number of the force law, by its index ([`ForceLaw::by_parameter`]).
    Law(usize),
}

/// Derivative of the state with respect to one number, carried along a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// The number.
    pub cause: Cause,
    /// d(q, v) / d(number) now.
    pub tangent: State,
}

impl Sensitivity {
    /// To coordinate `index` of the state now.
    pub fn to_coordinate(index: usize) -> Self {
        let mut tangent = State::zero();
        tangent.q[index] = 1.0;
        Self { cause: Cause::Start, tangent }
    }

    /// To velocity `index` of the state now.
    pub fn to_velocity(index: usize) -> Self {
        let mut tangent = State::zero();
        tangent.v[index] = 1.0;
        Self { cause: Cause::Start, tangent }
    }

    /// To a number that acts from now on.
    pub fn to(cause: Cause) -> Self {
        Self { cause, tangent: State::zero() }
    }
}

/// One step of the classical Runge-Kutta method, order 4, as [`crate::integrate::step_rk4`], together with the tangents:
/// each sensitivity goes through the same method by the chain rule, so that it is the exact derivative of the computed
/// step. Started at [`Sensitivity::to_coordinate`] and `to_velocity` of every degree of freedom, they are the columns of
/// the state-transition matrix.
pub fn step_with_derivatives(
    model: &Model,
    state: &State,
    step_s: f64,
    law: &impl ForceLaw,
    sensitivities: &mut [Sensitivity],
) -> State {
    by_bodies!(model, step(model, state, step_s, law, sensitivities))
}

fn step<const B: usize>(
    model: &Model,
    state: &State,
    step_s: f64,
    law: &impl ForceLaw,
    sensitivities: &mut [Sensitivity],
) -> State {
    let half = 0.5 * step_s;
    let s1 = Stage::<B>::at(model, law, 0.0, state);
    let second = State { q: state.q + half * state.v, v: state.v + half * s1.by.forward.acc };
    let s2 = Stage::<B>::at(model, law, half, &second);
    let third = State { q: state.q + half * second.v, v: state.v + half * s2.by.forward.acc };
    let s3 = Stage::<B>::at(model, law, half, &third);
    let fourth = State { q: state.q + step_s * third.v, v: state.v + step_s * s3.by.forward.acc };
    let s4 = Stage::<B>::at(model, law, step_s, &fourth);
    for sensitivity in sensitivities {
        let d1 = sensitivity.tangent;
        let a1 = s1.tangent(model, law, sensitivity.cause, &d1);
        let d2 = State { q: d1.q + half * d1.v, v: d1.v + half * a1 };
        let a2 = s2.tangent(model, law, sensitivity.cause, &d2);
        let d3 = State { q: d1.q + half * d2.v, v: d1.v + half * a2 };
        let a3 = s3.tangent(model, law, sensitivity.cause, &d3);
        let d4 = State { q: d1.q + step_s * d3.v, v: d1.v + step_s * a3 };
        let a4 = s4.tangent(model, law, sensitivity.cause, &d4);
        sensitivity.tangent = State {
            q: d1.q + step_s / 6.0 * (d1.v + 2.0 * (d2.v + d3.v) + d4.v),
            v: d1.v + step_s / 6.0 * (a1 + 2.0 * (a2 + a3) + a4),
        };
    }
    State {
        q: state.q + step_s / 6.0 * (state.v + 2.0 * (second.v + third.v) + fourth.v),
        v: state.v
            + step_s / 6.0 * (s1.by.forward.acc + 2.0 * (s2.by.forward.acc + s3.by.forward.acc) + s4.by.forward.acc),
    }
}

/// The equations of motion linearised at one stage of the step, forces included.
struct Stage<const B: usize> {
    time_s: f64,
    state: State,
    by: Linearized<B>,
    by_q: MassMatrix,
    by_v: MassMatrix,
}

impl<const B: usize> Stage<B> {
    #[inline(always)]
    fn at(model: &Model, law: &impl ForceLaw, time_s: f64, state: &State) -> Self {
        let by = Linearized::<B>::at(model, state, &law.forces(time_s, state));
        let (mut by_q, mut by_v) = (by.forward.by_q, by.forward.by_v);
        if let Some(gradient) = law.gradient(time_s, state) {
            by_q += by.forward.by_force * gradient.by_q;
            by_v += by.forward.by_force * gradient.by_v;
        }
        Self { time_s, state: *state, by, by_q, by_v }
    }

    /// Accelerations per unit of the cause: directly, and through the state that it has moved.
    #[inline(always)]
    fn tangent(&self, model: &Model, law: &impl ForceLaw, cause: Cause, tangent: &State) -> Coordinates {
        let mut acc = match cause {
            Cause::Start => Coordinates::zeros(),
            Cause::Force(index) => self.by.forward.by_force.column(index).into_owned(),
            Cause::Parameter(parameter) => self.by.by_parameter(model, parameter),
            Cause::Law(index) => self.by.by_force(&law.by_parameter(self.time_s, &self.state, index)),
        };
        for k in 0..B + 2 {
            let (dq, dv) = (tangent.q[k], tangent.v[k]);
            for i in 0..B + 2 {
                acc[i] += self.by_q[(i, k)] * dq + self.by_v[(i, k)] * dv;
            }
        }
        acc
    }
}
