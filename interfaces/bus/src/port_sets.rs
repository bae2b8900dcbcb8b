//! All ports of a service: the traits, and the macros that state the ports once.

use crate::{Bus, BusError, PortVisitor, Time};
use fss_messages::Step;

/// All inputs of a service; made by [`inputs!`](crate::inputs).
pub trait InputPorts: Sized {
    /// The ports' names, in order.
    const NAMES: &'static [&'static str];
    /// Opens all.
    ///
    /// # Errors
    /// Where the bus refuses one.
    fn open(bus: &Bus) -> Result<Self, BusError>;
    /// Takes what has come since the last step.
    fn refresh(&mut self);
    /// The ages of the ports' newest samples, ns.
    fn ages_ns(&self, now: Time, ages: &mut [u64]);
    /// Writes into a step's record what the last refresh left in hand; false where the service's steps are not recorded.
    fn record(&self, step: &mut Step) -> bool;
    /// Shows all in order; none of a set that is made anew for each stack.
    fn visit(_visitor: &mut impl PortVisitor) {}
}

/// All outputs of a service; made by [`outputs!`](crate::outputs).
pub trait OutputPorts: Sized {
    /// Opens all.
    ///
    /// # Errors
    /// Where the bus refuses one.
    fn open(bus: &Bus) -> Result<Self, BusError>;
    /// Sends what the step has published; returns how many samples could not be sent.
    fn flush(&mut self, now: Time) -> u64;
    /// Shows all in order; none of a set that is made anew for each stack.
    fn visit(_visitor: &mut impl PortVisitor) {}
}

/// Defines a service's inputs: `inputs! { /// Doc. pub struct Inputs { nav: Latest<NavState> = topic::NAV_STATE, } }`.
#[macro_export]
macro_rules! inputs {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $( $(#[$field_meta:meta])* $field:ident: $port:ty = $address:expr ),* $(,)?
    }) => {
        $(#[$meta])*
        $vis struct $name { $( $(#[$field_meta])* pub $field: $port, )* }

        impl $crate::InputPorts for $name {
            const NAMES: &'static [&'static str] = &[$(stringify!($field)),*];

            fn open(bus: &$crate::Bus) -> Result<Self, $crate::BusError> {
                Ok(Self { $( $field: <$port as $crate::InputPort>::open(bus, $address)?, )* })
            }

            fn refresh(&mut self) {
                $( $crate::InputPort::refresh(&mut self.$field); )*
            }

            fn ages_ns(&self, now: $crate::Time, ages: &mut [u64]) {
                let all = [$( $crate::InputPort::age_ns(&self.$field, now) ),*];
                for (slot, age) in ages.iter_mut().zip(all) {
                    *slot = age;
                }
            }

            fn record(&self, step: &mut $crate::Step) -> bool {
                const PORTS: usize = <$name as $crate::InputPorts>::NAMES.len();
                let all: [$crate::Taken; PORTS] = [$( $crate::InputPort::taken(&self.$field) ),*];
                for (i, taken) in all.into_iter().enumerate() {
                    (step.input[i], step.fresh[i]) = (taken.input, taken.fresh);
                }
                const { assert!(PORTS <= $crate::MAX_PORTS, "a step's record has no room for so many ports") };
                true
            }

            fn visit(visitor: &mut impl $crate::PortVisitor) {
                $( <$port as $crate::InputPort>::visit($address, visitor); )*
            }
        }
    };
}

/// Defines a service's outputs: `outputs! { /// Doc. pub struct Outputs { nav: Output<NavState> = topic::NAV_STATE, } }`.
#[macro_export]
macro_rules! outputs {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $( $(#[$field_meta:meta])* $field:ident: $port:ty = $address:expr ),* $(,)?
    }) => {
        $(#[$meta])*
        $vis struct $name { $( $(#[$field_meta])* pub $field: $port, )* }

        impl $crate::OutputPorts for $name {
            fn open(bus: &$crate::Bus) -> Result<Self, $crate::BusError> {
                Ok(Self { $( $field: <$port as $crate::OutputPort>::open(bus, $address)?, )* })
            }

            fn flush(&mut self, now: $crate::Time) -> u64 {
                let mut dropped = 0;
                $( dropped += $crate::OutputPort::flush(&mut self.$field, now); )*
                dropped
            }

            fn visit(visitor: &mut impl $crate::PortVisitor) {
                $( <$port as $crate::OutputPort>::visit($address, visitor); )*
            }
        }
    };
}
