//! Where the simulation is wrong: its error over what noise alone would give, channel by channel, window by window.
//!
//! Long simulations drift apart for any small reason, so each run is cut into windows with an initial state of their own
//! (multiple shooting). The joints go as telemetry and commands say, the base follows from momentum and thrust
//! ([`fss_plant::Rollout`]), and its initial state is fitted to the window.

use crate::evidence::Evidence;
use crate::trial::Trial;
use fss_diagnosis::diagnosis::ChannelMisfit;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;

/// The misfit of every channel that a run has; empty where the run has nothing that can be simulated.
pub(crate) fn of_run(plant: &Plant, run: &Run) -> Result<Vec<ChannelMisfit>, ModelError> {
    let trial = Trial::of(plant);
    let evidence = Evidence::gather(&trial, std::slice::from_ref(run))?;
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

/// Residuals of one channel as they are gathered.
#[derive(Default)]
struct Gathered {
    residuals: Vec<(f64, f64)>,
    square_sum: f64,
    /// Variance that noise alone gives, summed over the samples.
    noise_square_sum: f64,
    /// Degrees of freedom: samples less the parameters fitted to them.
    freedom: f64,
}

impl Gathered {
    fn add(&mut self, t_s: f64, residual: f64, noise_variance: f64) {
        self.residuals.push((t_s, residual));
        self.square_sum += residual * residual;
        self.noise_square_sum += noise_variance;
        self.freedom += 1.0;
    }

    fn finish(self, run: &str, channel: &str) -> Option<ChannelMisfit> {
        let noise = (self.noise_square_sum / self.residuals.len().max(1) as f64).sqrt();
        let rms = (self.square_sum / self.freedom.max(1.0)).sqrt();
        let (run, channel) = (run.to_owned(), channel.to_owned());
        (!self.residuals.is_empty()).then_some(ChannelMisfit { run, channel, rms, noise, residuals: self.residuals })
    }
}
