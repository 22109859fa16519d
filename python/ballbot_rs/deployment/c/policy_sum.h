static inline ballbot_real ballbot_policy_sum(const float *weights, const ballbot_real *values, int count)
{
    ballbot_real sum = 0;
    int i;
    for (i = 0; i < count; i++) {
        sum += weights[i] * values[i];
    }
    return sum;
}
