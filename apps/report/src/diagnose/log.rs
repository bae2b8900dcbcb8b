//! From a log of ours to the series that the identification works on.
//!
//! Only what the sensors said and what was commanded is read, never the simulated laboratory's truth. Times count from the
//! first of these samples.
//!
//! Joints are commanded 5 times a second with an angle and a rate, so that a driver follows a line with corners. What is
//! handed on as the joints' command is the motion that the plant's own drivers would make of it: the smooth part of what
//! telemetry, as slow as the commands, cannot show.

use fss_estimation::statistics::median;
use fss_experiments::commands::Commands;
use fss_experiments::measured::{self, Drive, Joints, Poses, Run, Series};
use fss_messages::{ArmCommand, GyroRate, LinksState, MAX_LINKS, MocapPose, Posture, Sample, ThrustersState, topic};
use fss_multibody::wrapped;
use fss_plant::{JointCommand, Plant};
use fss_records::log::{LOG_FILE, Log, Samples};
use miette::{IntoDiagnostic, Result, miette};
use std::path::{Path, PathBuf};

/// Telemetry of two joints within this time is one row, ns.
const ROW_NS: u64 = 1_000_000;
/// What a command takes over the radio to its link, s.
const COMMAND_TRANSIT_S: f64 = 0.005;

/// Between readings of the gyro that are this many times the usual interval apart, others were lost.
const LOST: f64 = 1.5;

/// The log that `path` is or, as a run's folder, holds; `None` where it is something else.
pub fn log_of(path: &Path) -> Option<PathBuf> {
    let inside = path.join(LOG_FILE);
    if path.is_dir() {
        return (inside.is_file() && !path.join("run.toml").exists()).then_some(inside);
    }
    path.is_file().then(|| path.to_owned())
}

/// Reads a log as a run.
///
/// # Errors
/// Names the file and what is wrong with it or missing.
pub fn read(path: &Path, plant: &Plant) -> Result<Run> {
    Record::read(path, plant)?.run(path, plant)
}

/// What was commanded in a log.
///
/// # Errors
/// Names the file and what is wrong with it or missing.
pub fn commands(path: &Path, plant: &Plant) -> Result<Commands> {
    let record = Record::read(path, plant)?;
    let joints = record.joints().unwrap_or_default();
    Ok(record.commands(&joints))
}

fn first<T: Sample>(samples: &[T]) -> u64 {
    samples.first().map_or(u64::MAX, |s| s.header().stamp_ns)
}

/// What stands in front of the topics' names.
fn vehicle<'a>(path: &Path, names: &'a [String]) -> Result<&'a str> {
    let mut vehicles: Vec<&str> = names.iter().filter_map(|name| name.strip_suffix(topic::MOCAP_BASE.name)).collect();
    vehicles.dedup();
    match vehicles[..] {
        [vehicle] => Ok(vehicle),
        [] => Err(miette!(
            help = "a run of `fss run` holds it; `fss log info` shows what this log holds",
            "{}: the log has no topic {}",
            path.display(),
            topic::MOCAP_BASE.name
        )),
        _ => Err(miette!("{}: the log holds several vehicles: {}", path.display(), vehicles.join(", "))),
    }
}

/// The samples of a log that count.
#[derive(Default)]
struct Record {
    start_ns: u64,
    base: Vec<MocapPose>,
    ee: Vec<MocapPose>,
    gyro: Vec<GyroRate>,
    links: Vec<LinksState>,
    arm: Vec<ArmCommand>,
    valves: Vec<ThrustersState>,
    postures: Vec<Posture>,
}

impl Record {
    fn read(path: &Path, plant: &Plant) -> Result<Self> {
        let log = Log::open(path).into_diagnostic()?;
        let names: Vec<String> = log.topics().into_diagnostic()?.into_iter().map(|t| t.topic).collect();
        let vehicle = vehicle(path, &names)?;
        let mut base = Samples::<MocapPose>::of(&format!("{vehicle}{}", topic::MOCAP_BASE.name));
        let mut ee = Samples::<MocapPose>::of(&format!("{vehicle}{}", topic::MOCAP_END_EFFECTOR.name));
        let mut gyro = Samples::<GyroRate>::of(&format!("{vehicle}{}", topic::GYRO.name));
        let mut links = Samples::<LinksState>::of(&format!("{vehicle}{}", topic::LINKS_STATE.name));
        let mut arm = Samples::<ArmCommand>::of(&format!("{vehicle}{}", topic::ARM_COMMAND.name));
        let mut valves = Samples::<ThrustersState>::of(&format!("{vehicle}{}", topic::THRUSTERS_STATE.name));
        let mut postures = Samples::<Posture>::of(&format!("{vehicle}{}", topic::CALIBRATION_POSTURE.name));
        log.collect(&mut [&mut base, &mut ee, &mut gyro, &mut links, &mut arm, &mut valves, &mut postures])
            .into_diagnostic()?;
        let record = Record {
            start_ns: [first(&base.samples), first(&ee.samples), first(&gyro.samples)].into_iter().min().unwrap_or(0),
            base: base.samples,
            ee: ee.samples,
            gyro: gyro.samples,
            links: links.samples,
            arm: arm.samples,
            valves: valves.samples,
            postures: postures.samples,
        };
        record.check(path, plant)?;
        Ok(record)
    }

    /// Refuses what cannot belong to the plant.
    fn check(&self, path: &Path, plant: &Plant) -> Result<()> {
        let path = path.display();
        if !self.base.iter().any(|pose| pose.quality == MocapPose::VALID) {
            return Err(miette!("{path}: {} holds no valid pose", topic::MOCAP_BASE.name));
        }
        let joints = self.links.last().map_or(0, |links| links.link_count as usize);
        if joints > plant.link_count() {
            return Err(miette!(
                "{path}: {} has {joints} links, but the plant file has {} [[link]] tables",
                topic::LINKS_STATE.name,
                plant.link_count()
            ));
        }
        let valves = self.valves.last().map_or(0, |valves| valves.valve_count as usize);
        if valves > plant.thrusters.len() {
            return Err(miette!(
                "{path}: {} has {valves} valves, but the plant file has {} [[thruster]] tables",
                topic::THRUSTERS_STATE.name,
                plant.thrusters.len()
            ));
        }
        Ok(())
    }

    fn run(&self, path: &Path, plant: &Plant) -> Result<Run> {
        let name = if path.file_name().is_some_and(|file| file == LOG_FILE) { path.parent() } else { Some(path) };
        let name = name.and_then(Path::file_stem).map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let joints = self.joints();
        let commands = joints.as_ref().map(|joints| self.commands(joints));
        let joint_command =
            commands.as_ref().map(|commands| commands.carried_out(plant)).transpose().into_diagnostic()?;
        Ok(Run {
            name,
            base_pose: self.poses(&self.base),
            ee_pose: self.poses(&self.ee),
            gyro: self.rates(),
            drive: if self.arm.is_empty() { Drive::Free } else { Drive::Servo },
            joints,
            joint_command,
            commands,
            thrust_levels: self.thrust_levels(),
            postures: self.postures(),
        })
    }

    fn seconds(&self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.start_ns)) as f64 * 1e-9
    }

    fn poses(&self, samples: &[MocapPose]) -> Option<Poses> {
        let mut poses = Poses::default();
        let mut last = f64::NEG_INFINITY;
        for pose in samples.iter().filter(|pose| pose.quality == MocapPose::VALID) {
            let t_s = self.seconds(pose.stamp_ns);
            if t_s > last {
                let before = poses.values.last().map_or(pose.theta_rad, |before: &[f64; 3]| before[2]);
                let turn = wrapped(pose.theta_rad - before);
                poses.t_s.push(t_s);
                poses.values.push([pose.x_m, pose.y_m, before + turn]);
                last = t_s;
            }
        }
        (!poses.t_s.is_empty()).then_some(poses)
    }

    /// The gyro gives means since its last reading: they stand for the middle of that time. The first one, and those after lost ones,
    /// are means of the usual time.
    fn rates(&self) -> Option<Series> {
        let since_last = |pair: &[GyroRate]| pair[1].stamp_ns.saturating_sub(pair[0].stamp_ns) as f64 * 1e-9;
        let intervals_s: Vec<f64> = self.gyro.windows(2).map(since_last).collect();
        let usual_s = median(&mut intervals_s.clone()).unwrap_or(0.0);
        let own_s = intervals_s.into_iter().map(|own_s| if own_s < LOST * usual_s { own_s } else { usual_s });
        let means_of_s = std::iter::once(usual_s).chain(own_s);
        let mut rates = Series::default();
        for (reading, mean_of_s) in self.gyro.iter().zip(means_of_s).filter(|(reading, _)| reading.valid != 0) {
            let t_s = self.seconds(reading.stamp_ns) - 0.5 * mean_of_s;
            if rates.t_s.last().is_none_or(|last| t_s > *last) {
                rates.t_s.push(t_s);
                rates.values.push(reading.omega_rad_s);
            }
        }
        (!rates.t_s.is_empty()).then_some(rates)
    }

    /// Telemetry, each link at its own times: what a link did not measure in a row is no number.
    fn joints(&self) -> Option<Joints> {
        let count = self.links.last()?.link_count as usize;
        let count = count.min(MAX_LINKS);
        let mut reports: Vec<(u64, usize, [f64; 4])> = Vec::new();
        let mut newest = [0; MAX_LINKS];
        for state in &self.links {
            for i in 0..count {
                let measured_ns = state.measured_ns[i];
                if measured_ns > newest[i] && state.alive[i] != 0 {
                    newest[i] = measured_ns;
                    let torque_nm = if state.fault[i] & LinksState::FAULT_TORQUE_SENSOR == 0 {
                        state.torque_nm[i]
                    } else {
                        f64::NAN
                    };
                    let values = [state.measured_q_rad[i], state.qd_rad_s[i], state.current_a[i], torque_nm];
                    reports.push((measured_ns, i, values));
                }
            }
        }
        reports.sort_by_key(|report| report.0);
        let mut joints = Joints::default();
        let mut columns = vec![[const { Vec::new() }; 4]; count];
        let mut row_ns = None;
        for (measured_ns, i, values) in reports {
            let is_same_row = row_ns.is_some_and(|row| measured_ns - row < ROW_NS)
                && columns[i][0].last().is_some_and(|value: &f64| value.is_nan());
            if !is_same_row {
                row_ns = Some(measured_ns);
                joints.t_s.push(self.seconds(measured_ns));
                columns.iter_mut().flatten().for_each(|column| column.push(f64::NAN));
            }
            for (column, value) in columns[i].iter_mut().zip(values) {
                if let Some(last) = column.last_mut() {
                    *last = value;
                }
            }
        }
        for [q, qd, current, torque] in columns {
            joints.q_rad.push(q);
            joints.qd_rad_s.push(qd);
            joints.current_a.push(current);
            joints.torque_nm.push(torque);
        }
        (!joints.t_s.is_empty()).then_some(joints)
    }

    /// Each posture as its last sample says it.
    fn postures(&self) -> Vec<measured::Posture> {
        let of_one_rest = self.postures.chunk_by(|a, b| a.since_ns == b.since_ns).filter_map(<[Posture]>::last);
        let posture = |p: &Posture| measured::Posture {
            q_rad: p.q_rad.iter().take(p.link_count as usize).copied().collect(),
            tip: p.tip,
        };
        of_one_rest.map(posture).collect()
    }

    /// Valves as commanded at their driver, where that changed.
    fn openings(&self) -> Vec<(f64, Vec<bool>)> {
        let mut rows: Vec<(f64, Vec<bool>)> = Vec::new();
        for state in &self.valves {
            let open: Vec<bool> = state.valves[..state.valve_count as usize].iter().map(|valve| *valve != 0).collect();
            if rows.last().is_none_or(|last| last.1 != open) {
                rows.push((self.seconds(state.stamp_ns), open));
            }
        }
        rows
    }

    /// The same as levels.
    fn thrust_levels(&self) -> Vec<(f64, Vec<f64>)> {
        let levels = |open: Vec<bool>| open.into_iter().map(f64::from).collect();
        self.openings().into_iter().map(|(t_s, open)| (t_s, levels(open))).collect()
    }

    /// What was commanded, and from where.
    fn commands(&self, joints: &Joints) -> Commands {
        let known = |column: &Vec<f64>| column.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
        let pose = self.base.iter().find(|pose| pose.quality == MocapPose::VALID);
        Commands {
            pose: pose.map_or([0.0; 3], |p| [p.x_m, p.y_m, p.theta_rad]),
            q_rad: joints.q_rad.iter().map(known).collect(),
            joints: (0..joints.q_rad.len()).map(|link| self.issued(link)).collect(),
            valves: self.openings(),
            end_s: self.links.last().map_or(0.0, |state| self.seconds(state.stamp_ns)),
        }
    }

    /// What was sent to a link, and when it arrived, s.
    fn issued(&self, link: usize) -> Vec<(f64, JointCommand)> {
        let mut issued = Vec::new();
        let sent =
            self.links.windows(2).filter(|pair| pair[0].command_sequence[link] != pair[1].command_sequence[link]);
        for pair in sent {
            // A state goes out before the commands of its step.
            let sent_ns = pair[0].stamp_ns;
            let after = self.arm.partition_point(|command| command.published_ns <= sent_ns);
            let Some(command) = after.checked_sub(1).map(|at| &self.arm[at]) else { continue };
            let age_s = sent_ns.saturating_sub(command.stamp_ns) as f64 * 1e-9;
            let (q_rad, qd_rad_s) = (command.q_rad[link], command.qd_rad_s[link]);
            let told = match command.mode {
                ArmCommand::POSITION => JointCommand::Position { q_rad: q_rad + qd_rad_s * age_s, qd_rad_s },
                ArmCommand::VELOCITY => JointCommand::Velocity { qd_rad_s },
                ArmCommand::CURRENT => JointCommand::Current { current_a: command.current_a[link] },
                _ => JointCommand::Free,
            };
            issued.push((self.seconds(sent_ns) + COMMAND_TRANSIT_S, told));
        }
        issued
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn each_mean_of_the_gyro_stands_for_the_middle_of_its_own_time() {
        // Its clock and the laboratory's step make intervals of 10 and 11 ms; before the last reading, one was lost.
        let stamps_ms = [100, 110, 120, 131, 141, 152, 162, 182];
        let reading = |ms: &u64| GyroRate { stamp_ns: ms * 1_000_000, valid: 1, ..GyroRate::default() };
        let record = Record { gyro: stamps_ms.iter().map(reading).collect(), ..Record::default() };
        let found = record.rates().unwrap().t_s;
        for (t_s, ms) in found.iter().zip([95.0, 105.0, 115.0, 125.5, 136.0, 146.5, 157.0, 177.0]) {
            assert!((t_s - 1e-3 * ms).abs() < 1e-9, "{found:?}");
        }
        assert_eq!(found.len(), stamps_ms.len());
    }
}
