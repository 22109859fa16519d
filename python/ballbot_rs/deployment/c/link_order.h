/* How readings follow those of the last answer: 1 if they are new, 0 if they are the same again, since the answer was lost,
 * and it is to be sent again, -1 if they are late and to be ignored. Do not call it before there is an answer. */
static inline int ballbot_link_order(const ballbot_link_torques *answer, const ballbot_link_readings *readings)
{
    const uint32_t behind = readings->flags & BALLBOT_LINK_RESET ? BALLBOT_LINK_LATE : 0x80000000u;
    const uint32_t steps = readings->sequence - answer->sequence;
    return steps == 0 ? 0 : steps < 0u - behind ? 1 : -1;
}
