#include "motion.h"

#include "board_limits.h"

#define READING_US 1000
#define HALF_WRAP_COUNTS (512 * BOARD_COUNTS_PER_TURN)

static const double RAD_PER_COUNT = 6.283185307179586 / BOARD_COUNTS_PER_TURN;
static const float RAD_PER_COUNT_F = (float)(6.283185307179586 / BOARD_COUNTS_PER_TURN);
static const float S_PER_US = 1e-6f;

static void keep(motion_t *motion, int64_t t_us)
{
    motion->newest = (motion->newest + 1) % MOTION_READINGS;
    motion->readings[motion->newest] = (reading_t){t_us, motion->counts};
    motion->kept += motion->kept < MOTION_READINGS ? 1 : 0;
    motion->t_next_us = t_us + READING_US;
}

void motion_start(motion_t *motion, int64_t t_us, uint16_t counter)
{
    *motion = (motion_t){.counter = counter, .wrapped = (int16_t)counter};
    keep(motion, t_us);
}

void motion_update(motion_t *motion, int64_t t_us, uint16_t counter)
{
    int16_t step = (int16_t)(uint16_t)(counter - motion->counter); /* the counter's own wrap is taken out here */
    motion->counter = counter;
    motion->counts += (uint32_t)(int32_t)step;
    motion->wrapped += step;
    if (motion->wrapped >= HALF_WRAP_COUNTS) {
        motion->wrapped -= 2 * HALF_WRAP_COUNTS;
    } else if (motion->wrapped < -HALF_WRAP_COUNTS) {
        motion->wrapped += 2 * HALF_WRAP_COUNTS;
    }
    if (t_us >= motion->t_next_us) {
        keep(motion, t_us);
    }
}

turned_t motion_turned(const motion_t *motion, int64_t t_us, int32_t window_us)
{
    reading_t oldest = {t_us, motion->counts};
    for (uint32_t back = 0; back < motion->kept; back++) {
        reading_t reading = motion->readings[(motion->newest + MOTION_READINGS - back) % MOTION_READINGS];
        if (t_us - reading.t_us > window_us) {
            break;
        }
        oldest = reading;
    }
    return (turned_t){(int32_t)(motion->counts - oldest.counts), (int32_t)(t_us - oldest.t_us)};
}

float motion_theta_rad(const motion_t *motion)
{
    return (float)(motion->wrapped * RAD_PER_COUNT);
}

float motion_speed_rad_s(const motion_t *motion, int64_t t_us, int32_t window_us)
{
    turned_t turned = motion_turned(motion, t_us, window_us);
    if (turned.us < READING_US) {
        return 0.0f; /* just started: a count over nearly no time is no speed */
    }
    /* speed = counts * rad per count / time */
    return (float)turned.counts * RAD_PER_COUNT_F / ((float)turned.us * S_PER_US);
}

bool motion_faster(const motion_t *motion, int64_t t_us, int32_t window_us, float limit_rad_s)
{
    turned_t turned = motion_turned(motion, t_us, window_us);
    int32_t counts = turned.counts < 0 ? -turned.counts : turned.counts;
    /* (counts - 1) * rad per count > limit * time */
    return turned.us > 0 && (float)(counts - 1) * RAD_PER_COUNT_F > limit_rad_s * (float)turned.us * S_PER_US;
}
