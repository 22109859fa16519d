/* The factor that brings a vector to the length `longest`, at most 1. */
static inline ballbot_real ballbot_share_within(const ballbot_real v[2], ballbot_real longest)
{
    const ballbot_real length = ballbot_sqrt(v[0] * v[0] + v[1] * v[1]);
    return length > longest ? longest / length : 1;
}
