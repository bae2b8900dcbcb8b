//! Sine and cosine of several angles at once.
//!
//! The chain needs them for every body at every evaluation, and library calls, one angle at a time, cost as much as all
//! the rest of the dynamics. Branch-free Cody-Waite reduction and the minimax polynomials of fdlibm (Sun Microsystems,
//! 1993, `k_sin.c`, `k_cos.c`) over an array compile to vector instructions, and give the same bits on every machine.

// The constants stand as published.
#![allow(clippy::excessive_precision)]

/// Largest angle (rad) whose quotient by pi/2 keeps the reduction's first two products exact.
const LARGEST: f64 = 1.0e6;
/// Adding and subtracting 1.5 * 2^52 rounds to the nearest integer and leaves it in the low bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// pi/2 in three parts, the first two of 33 bits.
const HALF_PI: [f64; 3] =
    [1.570_796_326_734_125_614_17, 6.077_100_506_303_965_976_60e-11, 2.022_266_248_795_950_631_54e-21];

/// Cosines and sines of `angles` (rad), to within 1.5 units in the last place.
#[inline(always)]
pub(crate) fn cos_sin<const N: usize>(angles: &[f64; N]) -> ([f64; N], [f64; N]) {
    let mut cos = [0.0; N];
    let mut sin = [0.0; N];
    let mut largest = 0.0_f64;
    let mut finite = 0.0_f64;
    for angle in angles {
        largest = largest.max(angle.abs());
        finite += angle * 0.0;
    }
    if !(largest <= LARGEST && finite == 0.0) {
        return by_library(angles);
    }
    for i in 0..N {
        let (c, s) = reduced(angles[i]);
        cos[i] = c;
        sin[i] = s;
    }
    (cos, sin)
}

#[inline(always)]
fn reduced(angle: f64) -> (f64, f64) {
    let shifted = angle * std::f64::consts::FRAC_2_PI + ROUNDER;
    let quadrant = shifted.to_bits();
    let turns = shifted - ROUNDER;
    let r = ((angle - turns * HALF_PI[0]) - turns * HALF_PI[1]) - turns * HALF_PI[2];
    let z = r * r;

    let sin_tail = 8.333_333_333_322_489_461_24e-03
        + z * (-1.984_126_982_985_794_931_34e-04
            + z * (2.755_731_370_707_006_767_89e-06
                + z * (-2.505_076_025_340_686_341_95e-08 + z * 1.589_690_995_211_550_102_21e-10)));
    let sine = r + z * r * (-1.666_666_666_666_663_243_48e-01 + z * sin_tail);

    let cos_tail = 4.166_666_666_666_660_190_37e-02
        + z * (-1.388_888_888_887_410_957_49e-03
            + z * (2.480_158_728_947_672_941_78e-05
                + z * (-2.755_731_435_139_066_330_35e-07
                    + z * (2.087_572_321_298_174_827_90e-09 + z * -1.135_964_755_778_819_482_65e-11))));
    let half = 0.5 * z;
    let near_one = 1.0 - half;
    let cosine = near_one + (((1.0 - near_one) - half) + z * z * cos_tail);

    // Odd quadrants exchange the two; the signs follow from the quadrant's second bit. Masks instead of branches.
    let exchange = (quadrant & 1).wrapping_neg();
    let (s, c) = (sine.to_bits(), cosine.to_bits());
    let flip = (s ^ c) & exchange;
    let sin_sign = (quadrant & 2) << 62;
    let cos_sign = (quadrant.wrapping_add(1) & 2) << 62;
    (f64::from_bits((c ^ flip) ^ cos_sign), f64::from_bits((s ^ flip) ^ sin_sign))
}

#[cold]
#[inline(never)]
fn by_library<const N: usize>(angles: &[f64; N]) -> ([f64; N], [f64; N]) {
    (angles.map(f64::cos), angles.map(f64::sin))
}

#[cfg(test)]
mod tests {
    use super::cos_sin;

    #[test]
    fn sines_and_cosines_agree_with_the_library_to_two_units_in_the_last_place() {
        let mut angle = -400_000.0;
        while angle < 400_000.0 {
            let ([c], [s]) = cos_sin(&[angle]);
            assert!((c - angle.cos()).abs() <= 2.0 * f64::EPSILON * angle.cos().abs(), "cos {angle}: {c}");
            assert!((s - angle.sin()).abs() <= 2.0 * f64::EPSILON * angle.sin().abs(), "sin {angle}: {s}");
            angle += 7.531_246_1;
        }
        for k in -4000..4000 {
            let near = f64::from(k) * std::f64::consts::FRAC_PI_4;
            for angle in [near, near + 1e-9, near - 1e-5] {
                let ([c], [s]) = cos_sin(&[angle]);
                assert!((c - angle.cos()).abs() <= 2.0 * f64::EPSILON * angle.cos().abs(), "cos {angle}: {c}");
                assert!((s - angle.sin()).abs() <= 2.0 * f64::EPSILON * angle.sin().abs(), "sin {angle}: {s}");
            }
        }
    }

    #[test]
    fn huge_angles_and_non_numbers_are_left_to_the_library() {
        let ([c, d], [s, _]) = cos_sin(&[1e15, f64::NAN]);
        assert_eq!((c, s), (1e15_f64.cos(), 1e15_f64.sin()));
        assert!(d.is_nan());
        assert!(cos_sin(&[f64::INFINITY]).0[0].is_nan());
    }
}
