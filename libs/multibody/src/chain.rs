//! The chain at one configuration: the lumped vectors turned into table axes.

use nalgebra::Vector2;

use crate::{Coordinates, Model, trig::cos_sin};

/// Vectors `d_i` and `s_i` of `B` bodies in table axes. With `B` the number of bodies it is the fast path, with
/// `MAX_BODIES` it serves every model: absent bodies have zero vectors and no mass.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain<const B: usize> {
    /// Absolute angles `phi_i`, rad.
    pub(crate) angle: [f64; B],
    pub(crate) cos: [f64; B],
    pub(crate) sin: [f64; B],
    pub(crate) d: [Vector2<f64>; B],
    pub(crate) s: [Vector2<f64>; B],
}

impl<const B: usize> Chain<B> {
    #[inline(always)]
    pub(crate) fn at(model: &Model, q: &Coordinates) -> Self {
        let lumps = &model.lumps;
        let mut angle = [0.0; B];
        angle[0] = q[2];
        for i in 1..B {
            angle[i] = angle[i - 1] + q[2 + i] + lumps.angle[i];
        }
        let (cos, sin) = cos_sin(&angle);
        let mut d = [Vector2::zeros(); B];
        let mut s = [Vector2::zeros(); B];
        d[0] = rotate(cos[0], sin[0], &lumps.d[0]);
        for i in 0..B {
            if i > 0 {
                d[i] = Vector2::new(cos[i] * lumps.d[i].x, sin[i] * lumps.d[i].x);
            }
            s[i] = rotate(cos[i], sin[i], &lumps.s[i]);
        }
        Self { angle, cos, sin, d, s }
    }

    /// A vector fixed in body `i`, in table axes.
    #[inline(always)]
    pub(crate) fn turned(&self, i: usize, vector: &Vector2<f64>) -> Vector2<f64> {
        rotate(self.cos[i], self.sin[i], vector)
    }
}

/// Absolute angular rates `phi_i'` (or accelerations) from generalized ones.
#[inline(always)]
pub(crate) fn absolute<const B: usize>(v: &Coordinates) -> [f64; B] {
    let mut rate = [0.0; B];
    rate[0] = v[2];
    for i in 1..B {
        rate[i] = rate[i - 1] + v[2 + i];
    }
    rate
}

#[inline(always)]
fn rotate(cos: f64, sin: f64, v: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

/// A quarter turn counter-clockwise: `d/d(phi)` of a vector that turns with `phi`.
#[inline(always)]
pub(crate) fn perp(v: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// `a x b`, out of the plane.
#[inline(always)]
pub(crate) fn cross(a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

/// Calls a function generic in the number of bodies with that of `$model`.
macro_rules! by_bodies {
    ($model:expr, $function:ident($($argument:expr),*)) => {
        match $model.link_count() {
            0 => $function::<1>($($argument),*),
            1 => $function::<2>($($argument),*),
            2 => $function::<3>($($argument),*),
            3 => $function::<4>($($argument),*),
            4 => $function::<5>($($argument),*),
            5 => $function::<6>($($argument),*),
            6 => $function::<7>($($argument),*),
            7 => $function::<8>($($argument),*),
            _ => $function::<{ $crate::MAX_BODIES }>($($argument),*),
        }
    };
}
pub(crate) use by_bodies;
