//! Many services in one process on a virtual clock.

use crate::{BusError, Runner, Service, Time};

/// Something that is stepped at a fixed rate.
pub trait Tick {
    /// One step at `now`, its outputs sent.
    ///
    /// # Errors
    /// Where it is the step of another process, and that does not answer.
    fn tick(&mut self, now: Time) -> Result<(), BusError>;
}

impl<S: Service> Tick for Runner<S> {
    fn tick(&mut self, now: Time) -> Result<(), BusError> {
        self.step(now);
        self.flush(now);
        Ok(())
    }
}

impl Tick for Box<dyn Tick + '_> {
    fn tick(&mut self, now: Time) -> Result<(), BusError> {
        (**self).tick(now)
    }
}

struct Member<'a> {
    tick: Box<dyn Tick + 'a>,
    period_ns: u64,
    next_ns: u64,
}

/// Steps its members in the order of their times; where two fall together, in the order in which they were added.
#[derive(Default)]
pub struct Stack<'a> {
    members: Vec<Member<'a>>,
}

impl<'a> Stack<'a> {
    /// A stack without members.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a member that is stepped at `phase_ns`, `phase_ns + period_ns` and so on.
    pub fn add(&mut self, tick: impl Tick + 'a, period_ns: u64, phase_ns: u64) {
        self.members.push(Member { tick: Box::new(tick), period_ns: period_ns.max(1), next_ns: phase_ns });
    }

    /// Steps the next member that is due; returns when that was. `None` where there is no member.
    ///
    /// # Errors
    /// Where the member fails.
    pub fn step(&mut self) -> Result<Option<Time>, BusError> {
        let Some(next) = self.members.iter_mut().min_by_key(|member| member.next_ns) else { return Ok(None) };
        let now = Time::from_ns(next.next_ns);
        next.tick.tick(now)?;
        next.next_ns += next.period_ns;
        Ok(Some(now))
    }
}
