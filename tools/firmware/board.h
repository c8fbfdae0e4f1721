/* The driver board: obeys good requests, answers them, and switches itself off. docs/reference/board.md is its contract.
 *
 * No heap, no operating system, no waiting: board_poll() is called again and again from one loop, at least once in the
 * time of a byte (86.8 us at 115200 baud). */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "frames.h"
#include "motion.h"

/* Three answers: more wait only where a host asks faster than the line can carry answers. */
#define SENDING_BYTES (3u * ANSWER_BYTES)

/* Why the torque is what it is. */
typedef enum {
    BECAUSE_START,
    BECAUSE_REQUEST,
    BECAUSE_SLEW,
    BECAUSE_CLEARED,
    BECAUSE_REFUSED,
    BECAUSE_TIMEOUT,
    BECAUSE_FAULT,
} because_t;

typedef struct {
    /* time since the start */
    uint32_t clock_us;
    int64_t now_us;
    /* line */
    decoder_t decoder;
    int64_t t_byte_us;
    uint8_t sending[SENDING_BYTES];
    size_t sending_length;
    uint8_t line_errors;
    bool has_seq;
    uint8_t seq;
    /* latches */
    bool has_good;
    int64_t t_good_us;
    bool timed_out, limited, fault;
    uint8_t fault_bits;
    /* torque */
    bool enabled;
    float torque_nm, target_nm;
    int64_t t_step_us;
    because_t because;
    uint32_t applied; /* counts what was given to the motor */
    /* sensors */
    motion_t motion;
    int64_t t_look_us;
    uint8_t looks_over_current;
} board_t;

/* Power on: disabled, nothing latched, the clock at zero. */
void board_start(board_t *board);

/* Do all that is due. */
void board_poll(board_t *board);

uint8_t board_status(const board_t *board);

#endif
