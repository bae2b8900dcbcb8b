//! An estimate into a plant file.

use super::Estimate;
use fss_plant::{Plant, Uncertainty};

/// The plant with what was determined written into it, and how well it is known now where the file has `[uncertainty]`.
///
/// Names are those of the unknowns: `base.joint1_x_m`, `link[2].length_m`, and `link[1..3].length_m` for a range of links.
/// What is off joint 1 stands in the angle of the base to it, as the paper has it.
pub fn calibrated(plant: &Plant, estimate: &Estimate) -> Plant {
    let mut plant = plant.clone();
    for p in &estimate.parameters {
        if let Some((first, last, field)) = of_links(&p.name) {
            for link in plant.links.iter_mut().take(last).skip(first - 1) {
                match field {
                    "length_m" => link.length_m = p.value,
                    "joint_offset_rad" => link.joint_offset_rad = p.value,
                    "com_to_next_joint_m" => link.com_to_next_joint_m = p.value,
                    "inertia_kg_m2" => link.inertia_kg_m2 = p.value,
                    "mass_kg" => link.mass_kg = p.value,
                    _ => {}
                }
            }
        } else {
            match p.name.as_str() {
                "base.joint1_x_m" => plant.base.joint1_xy_m[0] = p.value,
                "base.joint1_y_m" => plant.base.joint1_xy_m[1] = p.value,
                "base.joint1_angle_rad" => plant.base.joint1_angle_rad = p.value,
                "base.inertia_kg_m2" => plant.base.inertia_kg_m2 = p.value,
                "base.mass_kg" => plant.base.mass_kg = p.value,
                _ => {}
            }
        }
    }
    if let Some(uncertainty) = &mut plant.uncertainty {
        note(uncertainty, estimate, plant.links.len());
    }
    plant
}

/// `link[2].length_m` is `(2, 2, "length_m")`.
fn of_links(name: &str) -> Option<(usize, usize, &str)> {
    let (range, field) = name.strip_prefix("link[")?.split_once("].")?;
    let (first, last) = range.split_once("..").unwrap_or((range, range));
    Some((first.parse().ok().filter(|first| *first > 0)?, last.parse().ok()?, field))
}

/// Standard deviations for the whole kind: the largest, and only where the value of every link was determined.
fn note(uncertainty: &mut Uncertainty, estimate: &Estimate, links: usize) {
    let of_field = |field: &str, least: usize| {
        let mut covered = vec![false; links];
        let mut largest = 0.0_f64;
        for p in &estimate.parameters {
            if let Some((first, last, _)) = of_links(&p.name).filter(|(_, _, name)| *name == field) {
                covered.iter_mut().take(last).skip(first - 1).for_each(|c| *c = true);
                largest = largest.max(p.std);
            }
        }
        covered.iter().skip(least).all(|c| *c).then_some(largest).filter(|std| *std > 0.0)
    };
    let of_base = |name: &str| estimate.parameters.iter().find(|p| p.name == name).map(|p| p.std);
    let joint1_xy = of_base("base.joint1_x_m").zip(of_base("base.joint1_y_m")).map(|(x, y)| x.max(y));
    for (value, std) in [
        (&mut uncertainty.link_length_m, of_field("length_m", 0)),
        (&mut uncertainty.joint_offset_rad, of_field("joint_offset_rad", 1)),
        (&mut uncertainty.com_to_next_joint_m, of_field("com_to_next_joint_m", 0)),
        (&mut uncertainty.link_inertia_kg_m2, of_field("inertia_kg_m2", 0)),
        (&mut uncertainty.link_mass_kg, of_field("mass_kg", 0)),
        (&mut uncertainty.joint1_xy_m, joint1_xy),
        (&mut uncertainty.joint1_angle_rad, of_base("base.joint1_angle_rad")),
        (&mut uncertainty.base_inertia_kg_m2, of_base("base.inertia_kg_m2")),
        (&mut uncertainty.base_mass_kg, of_base("base.mass_kg")),
    ] {
        if let Some(std) = std {
            *value = std;
        }
    }
}
