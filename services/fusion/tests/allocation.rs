//! A step of the filter asks the heap for nothing, whatever the devices do.
#![allow(clippy::unwrap_used)]

use fss_bus::allocation::{Counting, allocations_in};
use fss_bus::{Bus, InputPort, Latest, Runner, Time};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_messages::{NavState, topic};
use fss_plant::Plant;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing_through_start_tracking_loss_and_restart() {
    let bus = Bus::local();
    let config = FusionConfig::from_plant(&Plant::default_laboratory().unwrap());
    let mut fusion = Runner::new(Fusion::new(config), &bus).unwrap();
    let (mocap, gyro) = (bus.queue(MOCAP_QUEUE, 64).unwrap(), bus.queue(GYRO_QUEUE, 64).unwrap());
    let mut nav = Latest::<NavState>::open(&bus, topic::NAV_STATE).unwrap();
    let mut modes = [false; 5];
    for k in 0..2000_u32 {
        let received_ns = 1_000_000_000_000 + u64::from(k) * 5_000_000;
        if k % 2 == 0 && k > 20 && !(600..1200).contains(&k) {
            let x = if k < 1500 { 0.1 } else { 0.6 } + f64::from(k % 5) * 1e-4;
            mocap.force_push(MocapPacket { received_ns, frame: k, poses: [Some([x, 0.2, 0.3]); 3] });
        }
        if !(400..=500).contains(&k) {
            gyro.force_push(GyroPacket { received_ns, rate_rad_s: f64::from(k % 3) * 1e-3, valid: true });
        }
        let allocations = allocations_in(|| fusion.step(Time::from_ns(received_ns)));
        assert_eq!(allocations, 0, "step {k}");
        fusion.flush(Time::from_ns(received_ns));
        nav.refresh();
        modes[usize::from(nav.get().unwrap().mode)] = true;
    }
    assert_eq!(modes, [true; 5], "every mode was flown");
}
