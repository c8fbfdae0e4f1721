/* Angle and speed of the hoop from the encoder's 16-bit counter. */
#ifndef MOTION_H
#define MOTION_H

#include <stdbool.h>
#include <stdint.h>

/* One reading every millisecond is kept for 32 ms. */
#define MOTION_READINGS 32u

typedef struct {
    int64_t t_us;
    uint32_t counts;
} reading_t;

typedef struct {
    uint16_t counter; /* the newest reading of the hardware */
    uint32_t counts;  /* all counts since the start, modulo 2^32: only differences count */
    int32_t wrapped;  /* the angle in counts, in [-512, 512) turns */
    reading_t readings[MOTION_READINGS];
    uint32_t newest, kept;
    int64_t t_next_us;
} motion_t;

/* Counts between two instants, and the time between them. */
typedef struct {
    int32_t counts;
    int32_t us;
} turned_t;

void motion_start(motion_t *motion, int64_t t_us, uint16_t counter);

/* Take a reading of the counter; at least one each 16 turns of the hoop, or it cannot be unwrapped. */
void motion_update(motion_t *motion, int64_t t_us, uint16_t counter);

/* What the hoop turned in the last milliseconds: `window_us`, less at the start and by up to a millisecond. */
turned_t motion_turned(const motion_t *motion, int64_t t_us, int32_t window_us);

float motion_theta_rad(const motion_t *motion);

/* Mean speed over the window in rad/s. */
float motion_speed_rad_s(const motion_t *motion, int64_t t_us, int32_t window_us);

/* Is the hoop surely faster than this? A count more or less cannot be told, so one is taken off. */
bool motion_faster(const motion_t *motion, int64_t t_us, int32_t window_us, float limit_rad_s);

#endif
