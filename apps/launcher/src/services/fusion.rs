//! `fusion`, motion capture and the gyro.

use super::linked::{Flight, Linked};
use crate::replay::player::FromDevice;
use crate::replay::tape::Tape;
use crate::seat::{Seat, wait_for_device};
use crate::stack::Stack;
use fss_bus::{Bus, Feed, Queue};
use fss_fusion::device::{read_gyro, receive_mocap};
use fss_fusion::{Fusion, GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_messages::{MocapPose, Step, topic};
use fss_service::NoConfig;
use miette::{IntoDiagnostic, Result, WrapErr, miette};

pub(super) struct Devices;

impl Linked for Devices {
    type Service = Fusion;

    fn config(&self, _stack: &Stack, _flight: &Flight<'_>) -> Result<NoConfig> {
        Ok(NoConfig {})
    }

    fn fly(&self, seat: &Seat, service: Fusion) -> Result<()> {
        let (devices, urgent) = (&seat.launch.devices, seat.is_real_time("fusion")?);
        let (frames, stop) = (seat.queue(MOCAP_QUEUE)?, seat.stop.clone());
        let mocap = receive_mocap(&devices.mocap, frames, stop, urgent)
            .into_diagnostic()
            .wrap_err_with(|| format!("motion capture: cannot receive {} ([devices] mocap)", devices.mocap))?;
        let path = &devices.gyro;
        let read = || read_gyro(path, seat.queue(GYRO_QUEUE)?, seat.stop.clone(), urgent).into_diagnostic();
        let gyro = wait_for_device(path, read)
            .wrap_err_with(|| format!("gyro: cannot open {} ([devices] gyro)", path.display()))?;
        seat.fly(service, || ())?;
        for thread in [mocap, gyro] {
            thread.join().map_err(|_| miette!("a device thread of fusion failed"))?;
        }
        Ok(())
    }

    fn devices<'a>(&self, bus: &Bus, tape: &'a Tape) -> Result<Vec<FromDevice<'a>>> {
        let mocap: Queue<MocapPacket> = bus.queue(MOCAP_QUEUE, Feed::<MocapPacket>::CAPACITY).into_diagnostic()?;
        let gyro: Queue<GyroPacket> = bus.queue(GYRO_QUEUE, Feed::<GyroPacket>::CAPACITY).into_diagnostic()?;
        let poses = [topic::MOCAP_BASE, topic::MOCAP_END_EFFECTOR, topic::MOCAP_TARGET];
        let [base, end_effector, target] = poses.map(|topic| tape.topic(topic));
        let bodies = [base?, end_effector?, target?];
        let rates = tape.topic(topic::GYRO)?;
        let give_mocap = move |step: &Step, _| {
            let frames = frames(bodies.map(|body| body.at(step.published_ns)));
            frames.iter().filter(|frame| mocap.push(**frame).is_ok()).count() as u64
        };
        let give_gyro = move |step: &Step, _| {
            let readings = rates.at(step.published_ns).iter().map(|reading| GyroPacket {
                received_ns: reading.received_ns,
                rate_rad_s: reading.omega_rad_s,
                valid: reading.valid != 0,
            });
            readings.filter(|reading| gyro.push(*reading).is_ok()).count() as u64
        };
        let (frames, readings) = ("motion capture frames", "gyro readings");
        Ok(vec![
            // A frame that names no body of ours is no sample, and does nothing.
            FromDevice { queue: MOCAP_QUEUE, name: frames, complete: false, give: Box::new(give_mocap) },
            FromDevice { queue: GYRO_QUEUE, name: readings, complete: true, give: Box::new(give_gyro) },
        ])
    }
}

/// Frames of motion capture put together again from the poses of their bodies.
fn frames(mut bodies: [&[MocapPose]; 3]) -> Vec<MocapPacket> {
    let mut frames = Vec::new();
    // All bodies stand in the order in which the frames came.
    while let Some(next) = bodies.iter().filter_map(|poses| poses.first()).min_by_key(|pose| pose.received_ns) {
        let (received_ns, frame) = (next.received_ns, next.frame);
        let poses = bodies.each_mut().map(|poses| {
            let (first, rest) = poses.split_first()?;
            let same = first.received_ns == received_ns && first.frame == frame;
            same.then(|| {
                *poses = rest;
                [first.x_m, first.y_m, first.theta_rad]
            })
        });
        frames.push(MocapPacket { received_ns, frame, poses });
    }
    frames
}
