/* ---- Rotations. */

static inline void ballbot_cross(const ballbot_real a[3], const ballbot_real b[3], ballbot_real out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The matrix of a unit quaternion. */
static inline void ballbot_matrix(const ballbot_real q[4], ballbot_real m[3][3])
{
    const ballbot_real w = q[0];
    const ballbot_real x = q[1];
    const ballbot_real y = q[2];
    const ballbot_real z = q[3];
    m[0][0] = 1 - 2 * (y * y + z * z);
    m[0][1] = 2 * (x * y - w * z);
    m[0][2] = 2 * (x * z + w * y);
    m[1][0] = 2 * (x * y + w * z);
    m[1][1] = 1 - 2 * (x * x + z * z);
    m[1][2] = 2 * (y * z - w * x);
    m[2][0] = 2 * (x * z - w * y);
    m[2][1] = 2 * (y * z + w * x);
    m[2][2] = 1 - 2 * (x * x + y * y);
}

/* A matrix times a vector, in place of another one. */
static inline void ballbot_times(ballbot_real m[3][3], const ballbot_real v[3], ballbot_real out[3])
{
    int i;
    for (i = 0; i < 3; i++) {
        out[i] = ballbot_dot(m[i], v, 3);
    }
}

/* The transposed matrix times a vector. */
static inline void ballbot_times_transposed(ballbot_real m[3][3], const ballbot_real v[3], ballbot_real out[3])
{
    int i;
    for (i = 0; i < 3; i++) {
        out[i] = m[0][i] * v[0] + m[1][i] * v[1] + m[2][i] * v[2];
    }
}

/* The product of quaternions, brought to length 1. */
static inline void ballbot_product(const ballbot_real a[4], const ballbot_real b[4], ballbot_real out[4])
{
    const ballbot_real w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    const ballbot_real x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    const ballbot_real y = a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3];
    const ballbot_real z = a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1];
    const ballbot_real inverse = 1 / ballbot_sqrt(w * w + x * x + y * y + z * z);
    out[0] = w * inverse;
    out[1] = x * inverse;
    out[2] = y * inverse;
    out[3] = z * inverse;
}

/* A quaternion, not of length 1, of a small rotation vector `share * v`: (1, tan(|half|) half / |half|) by a series. */
static inline void ballbot_small(const ballbot_real v[3], ballbot_real share, ballbot_real out[4])
{
    static const ballbot_real series[5] = {1382.0 / 155925.0, 62.0 / 2835.0, 17.0 / 315.0, 2.0 / 15.0, 1.0 / 3.0};
    const ballbot_real half = share / 2;
    const ballbot_real squared = half * half * ballbot_dot(v, v, 3);
    ballbot_real sum = 0;
    int i;
    for (i = 0; i < 5; i++) {
        sum = sum * squared + series[i];
    }
    out[0] = 1;
    for (i = 0; i < 3; i++) {
        out[i + 1] = half * v[i] * (sum * squared + 1);
    }
}
