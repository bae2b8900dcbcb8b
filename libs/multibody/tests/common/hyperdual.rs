//! Numbers that carry two first derivatives and the mixed second one (Fike and Alonso, AIAA 2011-886).

use std::ops::{Add, Mul, Neg, Sub};

#[derive(Clone, Copy, Debug)]
pub(crate) struct HyperDual {
    pub(crate) value: f64,
    pub(crate) by_a: f64,
    pub(crate) by_b: f64,
    pub(crate) by_ab: f64,
}

impl HyperDual {
    pub(crate) fn constant(value: f64) -> Self {
        Self { value, by_a: 0.0, by_b: 0.0, by_ab: 0.0 }
    }

    fn chain(self, f: f64, first: f64, second: f64) -> Self {
        Self {
            value: f,
            by_a: first * self.by_a,
            by_b: first * self.by_b,
            by_ab: first * self.by_ab + second * self.by_a * self.by_b,
        }
    }

    pub(crate) fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin(), -self.value.cos())
    }

    pub(crate) fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos(), -self.value.sin())
    }
}

impl Add for HyperDual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            value: self.value + o.value,
            by_a: self.by_a + o.by_a,
            by_b: self.by_b + o.by_b,
            by_ab: self.by_ab + o.by_ab,
        }
    }
}

impl Neg for HyperDual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, by_a: -self.by_a, by_b: -self.by_b, by_ab: -self.by_ab }
    }
}

impl Sub for HyperDual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl Mul for HyperDual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            by_a: self.by_a * o.value + self.value * o.by_a,
            by_b: self.by_b * o.value + self.value * o.by_b,
            by_ab: self.by_ab * o.value + self.by_a * o.by_b + self.by_b * o.by_a + self.value * o.by_ab,
        }
    }
}
