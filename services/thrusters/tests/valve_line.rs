//! The valve line of the simulated laboratory, and what happens when the laboratory goes and comes back.
#![allow(clippy::unwrap_used)]

use fss_bus::{Bus, Queue};
use fss_thrusters::device::{Driver, GpioLines, LaboratoryLine};
use fss_thrusters::{DRIVER_QUEUE, VALVES_QUEUE, ValvesCommand};
use fss_wire::valves::{FRAME_LEN, ValveFrame};
use std::io::Read;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;

struct Line {
    driver: Driver<LaboratoryLine>,
    masks: Queue<ValvesCommand>,
    reports: Queue<bool>,
}

impl Line {
    fn at(path: &Path) -> Self {
        let bus = Bus::local();
        Self {
            driver: Driver::new(LaboratoryLine::new(path), &bus).unwrap(),
            masks: bus.queue(VALVES_QUEUE, 64).unwrap(),
            reports: bus.queue(DRIVER_QUEUE, 64).unwrap(),
        }
    }

    /// Whether the driver could set this mask.
    fn set(&mut self, mask: u16) -> bool {
        self.masks.force_push(ValvesCommand { mask, at_ns: 0 });
        self.driver.apply();
        self.reports.pop().unwrap()
    }
}

fn next_frame(laboratory: &mut UnixStream) -> ValveFrame {
    let mut frame = [0; FRAME_LEN];
    laboratory.read_exact(&mut frame).unwrap();
    ValveFrame::decode(&frame).unwrap()
}

#[test]
fn every_step_sets_all_lines_and_the_newest_mask_counts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("valves.sock");
    let listener = UnixListener::bind(&path).unwrap();
    let mut line = Line::at(&path);
    line.masks.force_push(ValvesCommand { mask: 0b1, at_ns: 0 });
    assert!(line.set(0b1010));
    assert!(line.set(0b1010));
    let (mut laboratory, _) = listener.accept().unwrap();
    assert_eq!(next_frame(&mut laboratory), ValveFrame { mask: 0b1010, counter: 1 });
    assert_eq!(next_frame(&mut laboratory), ValveFrame { mask: 0b1010, counter: 2 }, "said again, so no frame matters");
    line.driver.shut().unwrap();
    assert_eq!(next_frame(&mut laboratory).mask, 0);
}

#[test]
fn a_laboratory_that_was_restarted_gets_its_line_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("valves.sock");
    let mut line = Line::at(&path);
    assert!(!line.set(0b1), "nobody is there yet");
    for _ in 0..2 {
        let listener = UnixListener::bind(&path).unwrap();
        assert!(line.set(0b1));
        let (mut laboratory, _) = listener.accept().unwrap();
        assert_eq!(next_frame(&mut laboratory).mask, 0b1);
        drop((laboratory, listener));
        std::fs::remove_file(&path).unwrap();
        assert!(!line.set(0b1), "the other end is gone, and that is said");
    }
}

#[test]
fn gpio_lines_that_cannot_be_taken_are_refused_with_their_chip_or_their_fault() {
    let refusal = |chip: &str, offsets: &[u32]| GpioLines::open(Path::new(chip), offsets).unwrap_err().to_string();
    assert!(refusal("/dev/no-such-chip", &[1, 2, 3]).contains("/dev/no-such-chip"));
    assert!(refusal("/dev/null", &[1, 2, 3]).contains("/dev/null"));
    assert!(refusal("/dev/gpiochip0", &[4, 5, 4]).contains("share"));
    assert!(refusal("/dev/gpiochip0", &[]).contains("1 to 16"));
}
