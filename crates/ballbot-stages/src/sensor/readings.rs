//! Readings of the sensors of a robot.

use ballbot_base::lanes::{Vec3, lane_struct};
use ballbot_base::wheels::Wheels;

lane_struct! {
    /// Readings of one robot or of eight at the end of a control step.
    #[derive(Clone, Copy, Debug)]
    pub struct Readings<T> {
        /// Angular velocity of the body, body frame, rad/s.
        pub gyro: Vec3<T>,
        /// Acceleration of the IMU minus gravity, body frame, m/s²: its mean over the control
        /// steps since the last sample.
        pub specific_force: Vec3<T>,
        /// Rotation of each wheel relative to the body since the start of the episode, rad.
        pub wheel_angles: Wheels<T>,
        /// Change of the wheel angles from one sample to the next, divided by the time between them, rad/s.
        pub wheel_rates: Wheels<T>,
    }
}
