//! Where a simulation differs from what was measured, and why: examine, linearize, whiten, search, conclude.
//!
//! - [`block`]: what the search needs of a set of channels of one run.
//! - [`base`]: the motion of a floating base.

pub mod base;
pub mod block;
mod candidates;
mod path;
mod problem;
mod search;
mod uncertain;

/// For trying out.
pub fn tried(plant: &fss_plant::Plant, runs: &[fss_identify::measured::Run]) -> String {
    let problem = match problem::Problem::new(plant, runs) {
        Ok(p) => p,
        Err(e) => return e.to_string(),
    };
    if problem.is_empty() {
        return "nothing".into();
    }
    let begun = std::time::Instant::now();
    let say = |what: &str| eprintln!("{:6.2} s {what}", begun.elapsed().as_secs_f64());
    match search::search(&problem, &say) {
        Ok(searched) => search::told(&problem, &searched),
        Err(e) => e.to_string(),
    }
}
