//! The navigation filter: a Kalman filter of a base that coasts between small random accelerations.
//!
//! With white acceleration noise the two translations and the rotation do not couple, so the seven states are three
//! small filters: (x, vx), (y, vy) and (theta, omega, gyro bias). Motion capture measures x, y and theta together, late;
//! the gyro measures omega + bias. The filter stands at the time of the newest measurement it has fused (the delayed
//! horizon); gyro readings that are newer wait until motion capture has caught up with them.
//!
//! How strong the accelerations are changes: a base that floats is shaken by air and thrusters, a base whose arm swings
//! by thirty times as much. So the process noise adapts. Innovations of a filter that follows are white; those of one that
//! lags keep their sign. Their running mean (`Unrest`) moves the density between that of a quiet and that of a restless
//! base, so that a quiet base has a quiet velocity and a swinging arm costs a fraction of a millimetre. Without motion
//! capture the base counts as restless, and the stated uncertainty grows accordingly.

use fss_bus::Time;
use nalgebra::{Matrix2, Matrix3, RowVector3, Vector2, Vector3};

/// 99.9 % of true innovations of a pose lie within this squared Mahalanobis distance (3 degrees of freedom).
pub const GATE_D2: f64 = 16.27;

/// Noise that the filter assumes; standard deviations, or densities of white noise where so named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Of one coordinate of a motion capture position, m.
    pub mocap_position_m: f64,
    /// Of a motion capture heading, rad.
    pub mocap_angle_rad: f64,
    /// Of a gyro reading, rad/s.
    pub gyro_rad_s: f64,
    /// Density of unknown acceleration of the base, m/s2 per root Hz: of a quiet and of a restless base.
    pub acceleration_m_s2_rt_hz: [f64; 2],
    /// Density of unknown angular acceleration of the base, rad/s2 per root Hz: of a quiet and of a restless base.
    pub angular_acceleration_rad_s2_rt_hz: [f64; 2],
    /// Density of the gyro bias's walk, rad/s per root s.
    pub bias_walk_rad_s_rt_s: f64,
}

/// A rate that differs from the expected one by more than this and so many standard deviations is refused: 20 rad/s2,
/// more than the arm's joints can do to the base, for the time between two readings.
const LARGEST_RATE_STEP_RAD_S: f64 = 0.2;
const RATE_GATE: f64 = 5.0;

/// What is not known at the first measurement; standard deviations.
const START_SPEED_M_S: f64 = 0.2;
const START_RATE_RAD_S: f64 = 0.5;
const START_BIAS_RAD_S: f64 = 0.01;

/// The base counts as restless when no pose has been used for this long, s.
const UNSEEN_S: f64 = 0.06;

/// How much the last innovations of one coordinate lean to one side: their running mean over their standard deviation.
#[derive(Clone, Copy, Debug, Default)]
struct Unrest(f64);

impl Unrest {
    /// Share of a new innovation in the mean. The mean of white innovations then has a standard deviation of 0.3.
    const SHARE: f64 = 1.0 / 6.0;
    /// Up to here the base is quiet, from there on it is restless.
    const RANGE: [f64; 2] = [0.4, 1.6];

    fn note(&mut self, innovation: f64, variance: f64) {
        self.0 += Self::SHARE * (innovation / variance.sqrt() - self.0);
    }

    fn of_two(self, other: Self) -> Self {
        Self(self.0.abs().max(other.0.abs()))
    }

    fn density(self, [quiet, restless]: [f64; 2]) -> f64 {
        let [from, to] = Self::RANGE;
        quiet + (restless - quiet) * ((self.0.abs() - from) / (to - from)).clamp(0.0, 1.0)
    }
}

/// A pose as motion capture measures it: x m, y m, theta rad.
pub type Pose = [f64; 3];

/// Position and velocity along one axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    state: Vector2<f64>,
    covariance: Matrix2<f64>,
}

impl Axis {
    fn start(position: f64, noise_m: f64) -> Self {
        let covariance = Matrix2::new(noise_m * noise_m, 0.0, 0.0, START_SPEED_M_S * START_SPEED_M_S);
        Self { state: Vector2::new(position, 0.0), covariance }
    }

    fn predict(&mut self, dt: f64, density: f64) {
        let transition = Matrix2::new(1.0, dt, 0.0, 1.0);
        let q = density * density;
        let process = Matrix2::new(dt * dt * dt / 3.0, dt * dt / 2.0, dt * dt / 2.0, dt) * q;
        self.state = transition * self.state;
        self.covariance = transition * self.covariance * transition.transpose() + process;
    }

    fn update(&mut self, innovation: f64, variance: f64) {
        let gain = self.covariance.column(0) / variance;
        self.state += gain * innovation;
        let row = self.covariance.row(0).into_owned();
        self.covariance -= gain * row;
    }
}

/// Heading, rate and gyro bias.
#[derive(Clone, Copy, Debug)]
struct Rotation {
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
}

impl Rotation {
    fn start(heading: f64, noise_rad: f64) -> Self {
        let sd = Vector3::new(noise_rad, START_RATE_RAD_S, START_BIAS_RAD_S);
        Self { state: Vector3::new(heading, 0.0, 0.0), covariance: Matrix3::from_diagonal(&sd.component_mul(&sd)) }
    }

    fn predict(&mut self, dt: f64, density: f64, bias_walk: f64) {
        let transition = Matrix3::new(1.0, dt, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let q = density * density;
        let walk = bias_walk * bias_walk * dt;
        let (a, b) = (q * dt * dt * dt / 3.0, q * dt * dt / 2.0);
        let process = Matrix3::new(a, b, 0.0, b, q * dt, 0.0, 0.0, 0.0, walk);
        self.state = transition * self.state;
        self.covariance = transition * self.covariance * transition.transpose() + process;
    }

    /// Takes the measurement `observation * state + noise` whose innovation this is; returns the innovation's variance.
    fn update(&mut self, observation: &RowVector3<f64>, innovation: f64, noise: f64) {
        let covariance_h = self.covariance * observation.transpose();
        let gain = covariance_h / ((observation * covariance_h)[0] + noise * noise);
        self.state += gain * innovation;
        self.covariance -= gain * covariance_h.transpose();
    }
}

/// The filter's estimate at one time.
#[derive(Clone, Copy, Debug)]
pub struct Filter {
    noise: Noise,
    time: Time,
    /// When the last used pose was measured.
    seen: Time,
    x: Axis,
    y: Axis,
    rotation: Rotation,
    /// Of x, y, theta and the gyro's rate.
    unrest: [Unrest; 4],
}

/// How a pose agreed with the prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// Measured less predicted: x m, y m, theta rad.
    pub pose: Pose,
    /// Squared Mahalanobis distance.
    pub d2: f64,
}

impl Filter {
    /// Starts at a first pose, at rest as far as it is known.
    pub fn start(time: Time, pose: Pose, noise: Noise) -> Self {
        let [x, y, theta] = pose;
        Self {
            noise,
            time,
            seen: time,
            x: Axis::start(x, noise.mocap_position_m),
            y: Axis::start(y, noise.mocap_position_m),
            rotation: Rotation::start(theta, noise.mocap_angle_rad),
            unrest: Default::default(),
        }
    }

    /// The time of the estimate.
    pub fn time(&self) -> Time {
        self.time
    }

    /// Goes on to `time`; does nothing where that is past.
    pub fn predict_to(&mut self, time: Time) {
        let dt = time.seconds_since(self.time);
        if dt > 0.0 {
            let (linear, angular) = (self.noise.acceleration_m_s2_rt_hz, self.noise.angular_acceleration_rad_s2_rt_hz);
            let unseen = time.seconds_since(self.seen) > UNSEEN_S;
            let density = |unrest: Unrest, range: [f64; 2]| if unseen { range[1] } else { unrest.density(range) };
            self.x.predict(dt, density(self.unrest[0], linear));
            self.y.predict(dt, density(self.unrest[1], linear));
            let walk = self.noise.bias_walk_rad_s_rt_s;
            self.rotation.predict(dt, density(self.unrest[2].of_two(self.unrest[3]), angular), walk);
            self.time = time;
        }
    }

    /// How a pose measured at the estimate's time agrees with it.
    pub fn innovation(&self, pose: Pose) -> Innovation {
        let turned = pose[2] - self.rotation.state[0];
        let pose = [pose[0] - self.x.state[0], pose[1] - self.y.state[0], turned.sin().atan2(turned.cos())];
        let variance = self.innovation_variance();
        let d2 = pose.iter().zip(variance).map(|(e, v)| e * e / v).sum();
        Innovation { pose, d2 }
    }

    fn innovation_variance(&self) -> [f64; 3] {
        let position = self.noise.mocap_position_m.powi(2);
        [
            self.x.covariance[(0, 0)] + position,
            self.y.covariance[(0, 0)] + position,
            self.rotation.covariance[(0, 0)] + self.noise.mocap_angle_rad.powi(2),
        ]
    }

    /// Takes a pose measured at the estimate's time, by its innovation.
    pub fn update_pose(&mut self, innovation: &Innovation) {
        let variance @ [x_variance, y_variance, _] = self.innovation_variance();
        for ((unrest, &innovation), variance) in self.unrest.iter_mut().zip(&innovation.pose).zip(variance) {
            unrest.note(innovation, variance);
        }
        self.seen = self.time;
        self.x.update(innovation.pose[0], x_variance);
        self.y.update(innovation.pose[1], y_variance);
        self.rotation.update(&RowVector3::new(1.0, 0.0, 0.0), innovation.pose[2], self.noise.mocap_angle_rad);
    }

    /// Takes a gyro reading made at the estimate's time, rad/s; returns false where it is refused, because no base changes
    /// its rate that fast.
    #[must_use]
    pub fn update_rate(&mut self, rate_rad_s: f64) -> bool {
        let innovation = rate_rad_s - self.rotation.state[1] - self.rotation.state[2];
        let c = &self.rotation.covariance;
        let variance = c[(1, 1)] + 2.0 * c[(1, 2)] + c[(2, 2)] + self.noise.gyro_rad_s.powi(2);
        if innovation.abs() > LARGEST_RATE_STEP_RAD_S + RATE_GATE * variance.sqrt() {
            return false;
        }
        self.unrest[3].note(innovation, variance);
        self.rotation.update(&RowVector3::new(0.0, 1.0, 1.0), innovation, self.noise.gyro_rad_s);
        true
    }

    /// x m, y m, theta rad, vx m/s, vy m/s, omega rad/s, gyro bias rad/s.
    pub fn state(&self) -> [f64; 7] {
        let (x, y, r) = (&self.x.state, &self.y.state, &self.rotation.state);
        [x[0], y[0], r[0], x[1], y[1], r[1], r[2]]
    }

    /// Standard deviations of [`Self::state`].
    pub fn standard_deviations(&self) -> [f64; 7] {
        let (x, y, r) = (&self.x.covariance, &self.y.covariance, &self.rotation.covariance);
        [x[(0, 0)], y[(0, 0)], r[(0, 0)], x[(1, 1)], y[(1, 1)], r[(1, 1)], r[(2, 2)]].map(|v| v.max(0.0).sqrt())
    }
}
