//! Order and groups of the rows.

/// Number of rows.
pub const ROWS: usize = 18;
/// First row of the ball's rates about x, y and the vertical, as speeds of its surface, m/s.
pub const TORQUE: usize = 0;
/// First row of the speeds along the free directions of the wheels.
pub const ROLLER: usize = 3;
/// First row of the rates of the wheel joints, as speeds of the rims, m/s.
pub const JOINT: usize = 6;
/// First row of the floor: normal, x, y.
pub const FLOOR: usize = 9;
/// First row of the normals of the wheels.
pub const NORMAL: usize = 12;
/// First row of the drive directions of the wheels.
pub const DRIVE: usize = 15;

/// The other row of a pair whose friction is within a disc.
pub fn partner(row: usize) -> Option<usize> {
    const X: usize = FLOOR + 1;
    const Y: usize = FLOOR + 2;
    match row {
        TORQUE => Some(TORQUE + 1),
        1 => Some(TORQUE),
        X => Some(Y),
        Y => Some(X),
        _ => None,
    }
}

/// The normal row whose impulse bounds that of a row.
pub fn load(row: usize) -> Option<usize> {
    match row {
        TORQUE..ROLLER => Some(FLOOR),
        ROLLER..JOINT => Some(row - ROLLER + NORMAL),
        FLOOR..NORMAL if row > FLOOR => Some(FLOOR),
        DRIVE..ROWS => Some(row - DRIVE + NORMAL),
        _ => None,
    }
}

/// The rows that any of the robots has, in the order of elimination. A row that a robot lacks has no impulse and changes
/// no bit of the others.
#[derive(Clone, Copy)]
pub struct Present {
    rows: [usize; ROWS],
    count: usize,
}

impl Present {
    /// Rows of contacts, and those of the ball's rates, of rollers and of joints if there is such friction.
    pub fn new(rates: bool, rollers: bool, joints: bool) -> Self {
        let mut present = Self { rows: [0; ROWS], count: 0 };
        for (group, first) in [(rates, TORQUE), (rollers, ROLLER), (joints, JOINT), (true, FLOOR)] {
            let last = if first == FLOOR { ROWS } else { first + 3 };
            for row in first..last {
                if group {
                    present.rows[present.count] = row;
                    present.count += 1;
                }
            }
        }
        present
    }

    /// The rows.
    pub fn rows(&self) -> &[usize] {
        &self.rows[..self.count]
    }
}
