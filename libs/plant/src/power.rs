//! What runs empty: the air tank and the batteries.

use crate::parts::{Battery, Tank};

/// Standard gravity, by which specific impulse is defined (m/s^2).
const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Air in the tank.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Air {
    tank: Option<Tank>,
    used_kg: f64,
}

impl Air {
    pub(crate) fn new(tank: Option<Tank>) -> Self {
        Self { tank, used_kg: 0.0 }
    }

    pub(crate) fn used_kg(&self) -> f64 {
        self.used_kg
    }

    /// Tank pressure (Pa), if there is a tank.
    pub(crate) fn pressure_pa(&self) -> Option<f64> {
        let tank = self.tank.as_ref()?;
        Some(tank.pressure_pa * (1.0 - self.used_kg / tank.gas_kg()).max(0.0))
    }

    /// Thrust over what a full tank gives: 1 until the regulator cannot hold its pressure.
    pub(crate) fn thrust_share(&self) -> f64 {
        match (&self.tank, self.pressure_pa()) {
            (Some(tank), Some(pressure)) => (pressure / tank.regulator_pa).min(1.0),
            _ => 1.0,
        }
    }

    /// Takes the gas of a total impulse (N s).
    pub(crate) fn take(&mut self, impulse_n_s: f64) {
        if let Some(tank) = &self.tank {
            let flow = impulse_n_s / (tank.specific_impulse_s * STANDARD_GRAVITY_M_S2);
            self.used_kg = (self.used_kg + flow).min(tank.gas_kg());
        }
    }
}

/// Charge of a battery.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Charge {
    battery: Option<Battery>,
    used_j: f64,
    load_w: f64,
}

impl Charge {
    pub(crate) fn new(battery: Option<Battery>) -> Self {
        Self { battery, used_j: 0.0, load_w: 0.0 }
    }

    /// Draws `load_w` beside the idle load for `dt_s`.
    pub(crate) fn draw(&mut self, load_w: f64, dt_s: f64) {
        if let Some(battery) = &self.battery {
            self.load_w = load_w + battery.idle_w;
            let full = battery.capacity_wh * 3600.0;
            self.used_j = (self.used_j + self.load_w * dt_s).min(full);
        }
    }

    /// Whether it can feed anything.
    pub(crate) fn is_alive(&self) -> bool {
        self.battery.as_ref().is_none_or(|b| self.used_j < b.capacity_wh * 3600.0)
    }

    /// Charge, 0 to 1, if there is a battery.
    pub(crate) fn charge(&self) -> Option<f64> {
        let battery = self.battery.as_ref()?;
        Some(1.0 - self.used_j / (battery.capacity_wh * 3600.0))
    }

    /// Terminal voltage (V), if there is a battery: linear in charge, less the drop inside.
    pub(crate) fn voltage_v(&self) -> Option<f64> {
        let battery = self.battery.as_ref()?;
        let open = battery.nominal_v * (0.85 + 0.3 * self.charge()?);
        Some(open - self.load_w / open * battery.resistance_ohm)
    }
}
