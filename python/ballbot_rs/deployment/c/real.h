/* ---- Numbers. `#define BALLBOT_REAL float` before the first include chooses single precision. */
#ifndef BALLBOT_REAL_KNOWN
#define BALLBOT_REAL_KNOWN

#ifndef BALLBOT_REAL
#define BALLBOT_REAL double
#endif

typedef BALLBOT_REAL ballbot_real;

/* The function of the right precision is chosen when this is compiled. */
#define BALLBOT_IS_FLOAT (sizeof(ballbot_real) == sizeof(float))

static inline ballbot_real ballbot_sqrt(ballbot_real x)
{
    return BALLBOT_IS_FLOAT ? (ballbot_real)sqrtf((float)x) : (ballbot_real)sqrt((double)x);
}

static inline ballbot_real ballbot_floor(ballbot_real x)
{
    return BALLBOT_IS_FLOAT ? (ballbot_real)floorf((float)x) : (ballbot_real)floor((double)x);
}

static inline ballbot_real ballbot_tanh(ballbot_real x)
{
    return BALLBOT_IS_FLOAT ? (ballbot_real)tanhf((float)x) : (ballbot_real)tanh((double)x);
}

static inline ballbot_real ballbot_exp(ballbot_real x)
{
    return BALLBOT_IS_FLOAT ? (ballbot_real)expf((float)x) : (ballbot_real)exp((double)x);
}

static inline ballbot_real ballbot_atan2(ballbot_real y, ballbot_real x)
{
    return BALLBOT_IS_FLOAT ? (ballbot_real)atan2f((float)y, (float)x) : (ballbot_real)atan2((double)y, (double)x);
}

static inline ballbot_real ballbot_abs(ballbot_real x)
{
    return x < 0 ? -x : x;
}

static inline ballbot_real ballbot_min(ballbot_real a, ballbot_real b)
{
    return a < b ? a : b;
}

static inline ballbot_real ballbot_max(ballbot_real a, ballbot_real b)
{
    return a > b ? a : b;
}

static inline ballbot_real ballbot_dot(const ballbot_real *a, const ballbot_real *b, int count)
{
    ballbot_real sum = 0;
    int i;
    for (i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

#endif
