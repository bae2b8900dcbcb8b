//! `pd`: holds the base where it finds it, by proportional and derivative control, in place of `base`.

use fss_service::messages::{MissionState, NavState, ThrustersCommand};
use fss_service::{Latest, Output, Program, Refusal, Service, Site, Time, inputs, main, message, outputs, topic, topics};
use serde::Deserialize;

/// Navigation that is older counts as none, ns.
const OLDEST_NS: u64 = 50_000_000;
/// Of the default vehicle in the posture of `hold`: kg, kg m2 about the centre of mass, and where that is in base axes, m.
const MASS_KG: f64 = 21.52;
const INERTIA_KG_M2: f64 = 6.0687;
const COM_M: [f64; 2] = [0.4608, 0.0712];
const THRUST_N: f64 = 0.159;
const LEVER_M: f64 = 0.065;
/// Direction of each thruster's push in base axes, and which way it turns the base.
const PUSHES: [[f64; 3]; 8] = [
    [-1.0, 0.0, 1.0],
    [-1.0, 0.0, -1.0],
    [1.0, 0.0, -1.0],
    [1.0, 0.0, 1.0],
    [0.0, -1.0, -1.0],
    [0.0, -1.0, 1.0],
    [0.0, 1.0, 1.0],
    [0.0, 1.0, -1.0],
];

message! {
    package pd_msgs;
    /// What `pd` sees.
    PdState {
        /// speed of the base, m/s
        speed_m_s: f64,
        /// 1 while it controls
        valid: u8,
        /// zero
        reserved0: [u8; 7],
    }
}

topic! {
    /// What `pd` sees; published once a step.
    STATE: PdState = "/pd/state",
}

inputs! {
    /// What it reads.
    pub struct Inputs {
        /// Where the base is.
        nav: Latest<NavState> = topics::NAV_STATE,
        /// Whether the mission runs.
        mission: Latest<MissionState> = topics::MISSION_STATE,
    }
}

outputs! {
    /// What it writes.
    pub struct Outputs {
        /// Once a step.
        state: Output<PdState> = STATE,
        /// The valves.
        thrusters: Output<ThrustersCommand> = topics::THRUSTERS_COMMAND,
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    bandwidth_rad_s: f64,
}

pub struct Pd {
    bandwidth_rad_s: f64,
    goal: Option<[f64; 3]>,
    owed: [f64; PUSHES.len()],
}

impl Program for Pd {
    type Config = Config;

    fn new(config: Config, _site: &Site) -> Result<Self, Refusal> {
        if config.bandwidth_rad_s <= 0.0 {
            return Err("config: bandwidth_rad_s is more than zero".into());
        }
        Ok(Self { bandwidth_rad_s: config.bandwidth_rad_s, goal: None, owed: [0.0; PUSHES.len()] })
    }
}

impl Pd {
    /// Share of open time of each thruster.
    fn duty_cycles(&mut self, nav: &NavState) -> [f64; PUSHES.len()] {
        let (pose, rate) = ([nav.x_m, nav.y_m, nav.theta_rad], [nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s]);
        let goal = *self.goal.get_or_insert(pose);
        let w = self.bandwidth_rad_s;
        let a: [f64; 3] = std::array::from_fn(|i| -w * w * (pose[i] - goal[i]) - 1.4 * w * rate[i]);
        let (s, c) = pose[2].sin_cos();
        let fx = MASS_KG * (c * a[0] + s * a[1] - a[2] * COM_M[1]);
        let fy = MASS_KG * (c * a[1] - s * a[0] + a[2] * COM_M[0]);
        let torque = INERTIA_KG_M2 * a[2] + COM_M[0] * fy - COM_M[1] * fx;
        PUSHES.map(|[x, y, way]| {
            let push = (x * fx).max(0.0) + (y * fy).max(0.0);
            push / (2.0 * THRUST_N) + (way * torque).max(0.0) / (4.0 * LEVER_M * THRUST_N)
        })
    }
}

impl Service for Pd {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "pd";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        let mut command = ThrustersCommand { stamp_ns: now.ns(), valve_count: 8, ..ThrustersCommand::default() };
        let mut state = PdState { stamp_ns: now.ns(), ..PdState::default() };
        let runs = inputs.mission.get().is_some_and(|mission| mission.state == MissionState::RUNNING);
        if let Some(nav) = inputs.nav.within(now, OLDEST_NS).filter(|_| runs) {
            for (thruster, duty) in self.duty_cycles(nav).into_iter().enumerate() {
                // A valve opens for a step when a step's impulse is owed.
                self.owed[thruster] += duty.min(1.0);
                if self.owed[thruster] >= 1.0 {
                    self.owed[thruster] -= 1.0;
                    command.valves[thruster] = 1;
                }
            }
            (state.speed_m_s, state.valid) = (nav.vx_m_s.hypot(nav.vy_m_s), 1);
        }
        outputs.thrusters.publish(command);
        outputs.state.publish(state);
    }
}

main!(Pd);
