//! The contact rows in the present pose: row velocities, and the effect of impulses on the velocities.
//!
//! Linear parts are in the inertial frame. Angular parts of the body are in its principal frame, where its inertia
//! is diagonal. Drive and normal impulses act on the bot; the opposite impulses act on the ball.

use super::constants::{Constants, at3};
use super::encoder::encoder_rates;
use super::ripple::Ripple;
use super::types::{PerRow, Velocities};
use ballbot_base::lanes::{Lane, Rotation, Value, Vec3};
use ballbot_base::wheels::{WHEELS, Wheels};

/// Lower bound of the sine of the angle between axle and contact normal. At zero the drive direction is undefined;
/// wheels in contact are far from it.
const MIN_AXLE_SINE: f64 = 1e-3;

/// Largest speed of recovery from an overlap, m/s. It limits the rebound of a robot deep in the floor. Chosen by
/// experiment.
const MAX_RECOVERY_SPEED: f64 = 1.0;

/// The rows of one step.
pub struct Rows<L: Lane> {
    /// Gap between each wheel and the ball, m; negative for an overlap.
    pub gaps: Wheels<L>,
    /// Gap between ball and floor, m; negative for an overlap.
    pub floor_gap: L,
    /// Ball center relative to the CoM of the body, principal frame.
    pub ball_in_body: Vec3<L>,
    /// Normals from the ball to each wheel, inertial frame.
    pub normals: Wheels<Vec3<L>>,
    /// Drive directions, along the axes of the rollers, inertial frame.
    pub drives: Wheels<Vec3<L>>,
    /// Products normal × drive, inertial frame.
    pub turns: Wheels<Vec3<L>>,
    /// Factors of the body rate in the normal rows, principal frame, m.
    pub normal_arms: Wheels<Vec3<L>>,
    /// Factors of the body rate in the drive rows, principal frame, m.
    pub drive_arms: Wheels<Vec3<L>>,
    /// Part of the speed of a wheel's rim along its drive direction: the sine of the angle between axle and normal, times the
    /// cosine of the rollers' angle.
    pub spin_shares: Wheels<L>,
    /// The rims of the wheels. Code generic over `RIPPLE` includes rim terms if it is true.
    pub ripple: Ripple<L>,
}

impl<L: Lane> Rows<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, rotation: &Rotation<L>, ball: Vec3<L>, body: Vec3<L>) -> Self {
        let ball_in_body = rotation.apply_transposed(ball - body);
        let a = Wheel::new(c, 0, ball_in_body);
        let b = Wheel::new(c, 1, ball_in_body);
        let d = Wheel::new(c, 2, ball_in_body);
        let normals = Wheels([rotation.apply(a.normal), rotation.apply(b.normal), rotation.apply(d.normal)]);
        let drives = Wheels([rotation.apply(a.drive), rotation.apply(b.drive), rotation.apply(d.drive)]);
        Self {
            gaps: Wheels([a.gap, b.gap, d.gap]),
            floor_gap: ball.z - c.ball_radius.at(ball.z),
            ball_in_body,
            turns: Wheels([normals[0].cross(drives[0]), normals[1].cross(drives[1]), normals[2].cross(drives[2])]),
            normals,
            drives,
            normal_arms: Wheels([a.normal_arm, b.normal_arm, d.normal_arm]),
            drive_arms: Wheels([a.drive_arm, b.drive_arm, d.drive_arm]),
            spin_shares: Wheels([a.spin_share, b.spin_share, d.spin_share]),
            ripple: Ripple::none(ball.z),
        }
    }

    /// The rows with the axes of the rollers inclined, in a plane parallel to the contact.
    #[inline(always)]
    pub fn with_inclined_rollers<V: Value<L>>(mut self, c: &Constants<V>, rotation: &Rotation<L>) -> Self {
        let like = self.floor_gap;
        let inclined = like.zero().lt(c.inclined.at(like));
        if !L::any(inclined) {
            return self;
        }
        let [cos, sin] = c.roller_axis;
        let (cos, sin) = (cos.at(like), sin.at(like));
        for i in 0..WHEELS {
            let (drive, turn, arm, share) = (self.drives[i], self.turns[i], self.drive_arms[i], self.spin_shares[i]);
            let free_arm = self.free_arm(c, rotation, i);
            self.drives[i] = Vec3::select(inclined, (drive * cos).plus(turn, sin), drive);
            self.turns[i] = Vec3::select(inclined, (turn * cos).plus(drive, -sin), turn);
            self.drive_arms[i] = Vec3::select(inclined, (arm * cos).plus(free_arm, sin), arm);
            self.spin_shares[i] = L::select(inclined, share * cos, share);
        }
        self
    }

    /// Factors of the body rate in the speed of the rim of wheel `i` along the direction `turns[i]`, without the wheel's
    /// spin, principal frame, m. Along the free direction the wheel touches the ball at its rim.
    #[inline(always)]
    pub fn free_arm<V: Value<L>>(&self, c: &Constants<V>, rotation: &Rotation<L>, i: usize) -> Vec3<L> {
        let in_body = rotation.apply_transposed(self.turns[i]);
        let rim = rotation.apply_transposed(self.drives[i]) * c.wheel_radius.at(self.floor_gap);
        c.wheel_center(i, self.floor_gap).cross(in_body) + rim
    }

    /// The rows with the rims of the wheels. A gap changes with the wheel angle, so the normal force acts on the joint:
    /// the constraint is a position constraint and does no work.
    #[inline(always)]
    pub fn with_ripple<V: Value<L>>(self, c: &Constants<V>, ripple: Ripple<L>) -> Self {
        let (mut gaps, mut normal_arms) = (self.gaps, self.normal_arms);
        for i in 0..WHEELS {
            gaps[i] = ripple.select(gaps[i] + ripple.depths[i], gaps[i]);
            let arm = normal_arms[i].plus(c.u(i, gaps[i]), ripple.slopes[i]);
            normal_arms[i] = Vec3::select(ripple.on, arm, normal_arms[i]);
        }
        Self { gaps, normal_arms, ripple, ..self }
    }

    /// Surface speed of wheel `i` relative to the ball along the drive direction.
    #[inline(always)]
    pub fn slip_speed<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>, i: usize) -> L {
        let rim = v.spins[i] * self.spin_shares[i] * c.wheel_radius.at(v.spins[i]);
        let body = self.drives[i].dot(v.body - v.ball) + self.drive_arms[i].dot(v.body_rate);
        body + rim - self.turns[i].dot(v.ball_rate) * c.ball_radius.at(rim)
    }

    /// Velocity of the lowest point of the ball, x and y.
    #[inline(always)]
    pub fn floor_slip<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>) -> [L; 2] {
        let radius = c.ball_radius.at(v.ball.x);
        [v.ball_rate.y.mul_add(-radius, v.ball.x), v.ball_rate.x.mul_add(radius, v.ball.y)]
    }

    #[inline(always)]
    fn approach<const RIPPLE: bool, V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>, i: usize) -> L {
        let mut speed = self.normals[i].dot(v.body - v.ball) + self.normal_arms[i].dot(v.body_rate);
        if RIPPLE {
            let of_rim = self.ripple.slopes[i].mul_add(v.spins[i], self.ripple.bends[i]);
            speed = self.ripple.select(speed + of_rim, speed);
        }
        speed + allowance(c, self.gaps[i])
    }

    /// Residuals that the impulses bring to zero: slip, and approach speed beyond the allowed speed.
    #[inline(always)]
    pub fn residuals<const RIPPLE: bool, V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>) -> PerRow<L> {
        let [x, y] = self.floor_slip(c, v);
        PerRow {
            floor: [v.ball.z + allowance(c, self.floor_gap), x, y],
            normals: Wheels([
                self.approach::<RIPPLE, V>(c, v, 0),
                self.approach::<RIPPLE, V>(c, v, 1),
                self.approach::<RIPPLE, V>(c, v, 2),
            ]),
            drives: Wheels([self.slip_speed(c, v, 0), self.slip_speed(c, v, 1), self.slip_speed(c, v, 2)]),
            joints: encoder_rates(c, v),
        }
    }

    /// Applies `impulses` to the velocities.
    #[inline(always)]
    pub fn apply<const JOINTS: bool, const RIPPLE: bool, V: Value<L>>(
        &self,
        c: &Constants<V>,
        impulses: &PerRow<L>,
        v: &mut Velocities<L>,
    ) {
        let like = v.ball.x;
        let mut bot_impulse = Vec3::zero(like);
        let mut ball_angular_impulse = bot_impulse;
        let mut body_angular_impulse = bot_impulse;
        for i in 0..WHEELS {
            let (normal, drive) = (impulses.normals[i], impulses.drives[i]);
            bot_impulse = bot_impulse.plus(self.normals[i], normal).plus(self.drives[i], drive);
            ball_angular_impulse = ball_angular_impulse.plus(self.turns[i], -drive);
            body_angular_impulse =
                body_angular_impulse.plus(self.normal_arms[i], normal).plus(self.drive_arms[i], drive);
            let mut wheel_impulse = drive * self.spin_shares[i] * c.wheel_radius.at(like);
            if JOINTS {
                body_angular_impulse = body_angular_impulse.plus(c.u(i, like), impulses.joints[i]);
                wheel_impulse += impulses.joints[i];
            }
            if RIPPLE {
                let with_rim = normal.mul_add(self.ripple.slopes[i], wheel_impulse);
                wheel_impulse = self.ripple.select(with_rim, wheel_impulse);
            }
            v.spins[i] = wheel_impulse.mul_add(c.wheel_inertia_inverse.at(like), v.spins[i]);
        }
        let [z, x, y] = impulses.floor;
        v.ball = v.ball.plus(Vec3::new(x, y, z) - bot_impulse, c.ball_mass_inverse.at(like));
        ball_angular_impulse += Vec3::new(y, -x, like.zero());
        v.ball_rate = v.ball_rate.plus(ball_angular_impulse, c.ball_rim_ratio.at(like));
        v.body = v.body.plus(bot_impulse, c.body_mass_inverse.at(like));
        v.body_rate += body_angular_impulse.scaled_by(at3(c.body_inertia_inverse, like));
    }
}

/// Largest speed at which a gap may close in one step; for an overlap, minus the recovery speed.
#[inline(always)]
pub fn allowance<L: Lane, V: Value<L>>(c: &Constants<V>, gap: L) -> L {
    let rate = L::select(gap.zero().lt(gap), c.sim_dt_inverse.at(gap), c.recovery.at(gap));
    (gap * rate).max(gap.splat(-MAX_RECOVERY_SPEED))
}

/// One wheel on the ball, in the principal frame.
struct Wheel<L> {
    gap: L,
    normal: Vec3<L>,
    drive: Vec3<L>,
    normal_arm: Vec3<L>,
    drive_arm: Vec3<L>,
    spin_share: L,
}

impl<L: Lane> Wheel<L> {
    #[inline(always)]
    fn new<V: Value<L>>(c: &Constants<V>, i: usize, ball: Vec3<L>) -> Self {
        let like = ball.x;
        let one = like.splat(1.0);
        let center = c.wheel_center(i, like);
        let u = c.u(i, like);
        let offset = center - ball;
        let distance = offset.norm_squared().sqrt();
        let normal = offset * (one / distance.max(like.splat(f64::MIN_POSITIVE)));

        // Component of the normal along the axle: zero while the ball center is at the origin of the body frame.
        let along = normal.dot(u);
        let spin_share = along.neg_mul_add(along, one).max(like.splat(MIN_AXLE_SINE * MIN_AXLE_SINE)).sqrt();
        let share_inverse = one / spin_share;
        let drive = u.cross(normal) * share_inverse;
        // The spin of the wheel replaces the body rate about the axle. This is the remaining effect of the body rate on
        // the rim velocity.
        let lost = (normal - u * along) * (along * share_inverse * c.wheel_radius.at(like));
        Self {
            gap: distance - c.contact_distance.at(like),
            normal,
            drive,
            normal_arm: center.cross(normal),
            drive_arm: center.cross(drive) + lost,
            spin_share,
        }
    }
}
