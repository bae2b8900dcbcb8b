//! A floating base: prescribed joints, momentum, thrust, a fitted initial state.

use super::{ChannelMisfit, Gathered, Windows};
use crate::evidence::Evidence;
use crate::trial::Trial;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;

/// The misfit of every channel of a run.
pub(super) fn misfit(plant: &Plant, run: &Run, windows: Windows) -> Result<Vec<ChannelMisfit>, ModelError> {
    let trial = Trial::of(plant);
    let evidence = Evidence::gather(&trial, std::slice::from_ref(run), windows)?;
    let Some(record) = evidence.records.first() else { return Ok(Vec::new()) };
    let flight = record.flight(&trial)?;
    let mut gathered: Vec<Gathered> = record.channels().iter().map(|_| Gathered::default()).collect();
    for cell in &evidence.cells {
        let span = &record.spans()[cell.window];
        let rows = flight.residuals(cell.window, std::slice::from_ref(&cell.unknowns)).remove(0);
        for (info, residual) in span.rows.iter().zip(rows) {
            gathered[info.channel].add(info.t_s, residual, info.variance);
        }
        // The fit has taken six degrees of freedom, two from each coordinate of the base.
        for channel in &mut gathered[..3] {
            channel.freedom -= 2.0;
        }
    }
    let named = gathered.into_iter().zip(record.channels());
    Ok(named.filter_map(|(g, name)| g.finish(&run.name, name)).collect())
}
