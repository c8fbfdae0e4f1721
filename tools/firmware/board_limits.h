/* What the board stands for by itself, and the numbers of its motor and encoder. docs/reference/board.md tells why.
 *
 * Every number may be given to the compiler instead: make host DEFINES='-DBOARD_OVERSPEED_RAD_S=50.0f'. */
#ifndef BOARD_LIMITS_H
#define BOARD_LIMITS_H

/* The motor driver saturates here; a demand beyond it is limited and told. */
#ifndef BOARD_TORQUE_LIMIT_NM
#define BOARD_TORQUE_LIMIT_NM 0.7f
#endif

/* From one extreme to the other in 2 ms. */
#ifndef BOARD_SLEW_NM_PER_MS
#define BOARD_SLEW_NM_PER_MS 0.7f
#endif

/* The rim then moves at 10 m/s; the host gives up at 60 rad/s. */
#ifndef BOARD_OVERSPEED_RAD_S
#define BOARD_OVERSPEED_RAD_S 100.0f
#endif

/* Another motor needs another number: 1.3 x torque limit / torque constant. */
#ifndef BOARD_CURRENT_LIMIT_A
#define BOARD_CURRENT_LIMIT_A 2.5f
#endif

/* Torque over current of the motor, seen at the hoop. */
#ifndef BOARD_TORQUE_CONSTANT_NM_PER_A
#define BOARD_TORQUE_CONSTANT_NM_PER_A 0.37f
#endif

/* All four edges of both tracks: an encoder of 1024 lines. */
#ifndef BOARD_COUNTS_PER_TURN
#define BOARD_COUNTS_PER_TURN 4096
#endif

#endif
