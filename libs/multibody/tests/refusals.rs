//! Mechanisms that cannot be are refused with the reason.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_multibody::{Base, Link, MAX_LINKS, Model};

fn refusal(base: Base, links: &[Link]) -> String {
    Model::new(base, links, [0.0; 2]).unwrap_err().to_string()
}

#[test]
fn impossible_mechanisms_are_refused_and_the_reason_names_the_part() {
    let (base, link) = (Base::default(), Link::default());
    let cases = [
        (refusal(Base { mass_kg: -1.0, ..base }, &[link]), "base: mass_kg is -1"),
        (refusal(Base { mass_kg: 0.0, ..base }, &[link]), "base: mass_kg is zero"),
        (refusal(Base { inertia_kg_m2: 0.0, ..base }, &[link]), "base: inertia_kg_m2 is zero"),
        (refusal(Base { com_m: [0.0, f64::NAN], ..base }, &[link]), "base: com_m is not a finite number"),
        (refusal(Base { clamped: true, ..base }, &[]), "nothing that can move"),
        (refusal(base, &[link, Link { mass_kg: -0.1, ..link }]), "link 2: mass_kg is -0.1"),
        (refusal(base, &[Link { length_m: f64::INFINITY, ..link }]), "link 1: length_m is not a finite number"),
        (refusal(base, &[Link { mass_kg: 0.0, inertia_kg_m2: 0.0, ..link }]), "link 1: inertia_kg_m2 is zero"),
        (refusal(base, &[link; MAX_LINKS + 1]), "9 links, but at most 8"),
    ];
    for (text, part) in cases {
        assert!(text.contains(part), "'{text}' does not say '{part}'");
    }
    let gravity = Model::new(base, &[link], [0.0, f64::NAN]).unwrap_err().to_string();
    assert!(gravity.contains("gravity_m_s2"), "{gravity}");
}

#[test]
fn a_clamped_base_may_weigh_nothing_and_a_link_may_be_a_point_mass() {
    let wall = Base { mass_kg: 0.0, inertia_kg_m2: 0.0, clamped: true, ..Base::default() };
    let bob = Link { inertia_kg_m2: 0.0, com_to_next_joint_m: 0.0, ..Link::default() };
    let model = Model::new(wall, &[bob], [0.0, -9.81]).unwrap();
    let acc = model.forward_dynamics(&fss_multibody::State::zero(), &fss_multibody::Coordinates::zeros());
    assert_eq!(acc[3], -9.81, "a point mass of 1 kg at 1 m, held level, starts to fall freely");
}
