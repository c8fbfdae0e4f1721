#include "board.h"

#include "board_hal.h"
#include "board_limits.h"

/* Five ticks of the host without a good request. */
#define TIMEOUT_US 100000
/* 23 byte times: no pause inside a frame is that long. */
#define PARTIAL_FRAME_US 2000
/* A motor driver's torque loop runs at 10 kHz; sensors are looked at as often. */
#define LOOP_US 100
#define STEP_NM (BOARD_SLEW_NM_PER_MS * 1e-3f * LOOP_US)

/* The speed of an answer: a count is 0.15 rad/s of it, and it is that of 5 ms ago. */
#define SPEED_US 10000
/* A run-up at 400 rad/s^2 passes the limit by two counts within 2 ms, and the window's mean is 2 ms old. */
#define FAST_CUT_US 4000
/* A speed just beyond the limit is told by a longer window: a count is 0.08 rad/s of it. */
#define SLOW_CUT_US 20000
/* A hoop that still turns is not energised again. */
#define REST_SHARE 0.1f
/* Half a millisecond beyond the limit is no spike of the power stage. */
#define LOOKS_OVER_CURRENT 5

#define HARDWARE_FAULTS (ERROR_OVERCURRENT | ERROR_ENCODER | ERROR_SUPPLY)

static float magnitude(float value)
{
    return value < 0.0f ? -value : value;
}

/* False for NaN and both infinities: nothing else minus itself is not zero. */
static bool is_number(float value)
{
    return value - value == 0.0f;
}

/* --- torque -------------------------------------------------------------------------------------------------------- */

static void apply(board_t *board, because_t because)
{
    board->because = because;
    board->applied++;
    board_hal_torque(board->torque_nm, board->enabled);
}

/* One step towards the target, no larger than the slew limit lets it be. */
static void approach(board_t *board)
{
    float missing = board->target_nm - board->torque_nm;
    if (magnitude(missing) <= STEP_NM) {
        board->torque_nm = board->target_nm;
    } else {
        board->torque_nm += missing > 0.0f ? STEP_NM : -STEP_NM;
    }
    board->t_step_us = board->now_us;
}

/* Off waits for nothing. */
static void switch_off(board_t *board, because_t because)
{
    board->enabled = board->limited = false;
    board->torque_nm = board->target_nm = 0.0f;
    apply(board, because);
}

static void drive(board_t *board, float demand_nm)
{
    float size = magnitude(demand_nm);
    board->limited = size > BOARD_TORQUE_LIMIT_NM;
    size = board->limited ? BOARD_TORQUE_LIMIT_NM : size;
    board->target_nm = demand_nm < 0.0f ? -size : size;
    board->enabled = true;
    if (board->now_us - board->t_step_us >= LOOP_US) {
        approach(board);
    }
    apply(board, BECAUSE_REQUEST);
}

static void step_torque(board_t *board)
{
    if (board->enabled && board->torque_nm != board->target_nm && board->now_us - board->t_step_us >= LOOP_US) {
        approach(board);
        apply(board, BECAUSE_SLEW);
    }
}

/* --- latches ------------------------------------------------------------------------------------------------------- */

static void trip(board_t *board, uint8_t bits)
{
    board->fault = true;
    board->fault_bits |= bits;
    switch_off(board, BECAUSE_FAULT);
}

static bool over_current(float current_a)
{
    return !(magnitude(current_a) <= BOARD_CURRENT_LIMIT_A); /* true for what is not a number, too */
}

/* Conditions that hold now. */
static uint8_t conditions(board_t *board)
{
    uint8_t bits = board_hal_faults() & HARDWARE_FAULTS;
    if (!over_current(board_hal_current())) {
        board->looks_over_current = 0;
    } else if (++board->looks_over_current >= LOOKS_OVER_CURRENT) {
        board->looks_over_current = LOOKS_OVER_CURRENT;
        bits |= ERROR_OVERCURRENT;
    }
    if (motion_faster(&board->motion, board->now_us, FAST_CUT_US, BOARD_OVERSPEED_RAD_S)
        || motion_faster(&board->motion, board->now_us, SLOW_CUT_US, BOARD_OVERSPEED_RAD_S)) {
        bits |= ERROR_OVERSPEED;
    }
    return bits;
}

/* Compare the board's own sensors with what it stands for. */
static void look(board_t *board)
{
    if (board->now_us < board->t_look_us) {
        return;
    }
    board->t_look_us = board->now_us + LOOP_US;
    uint8_t begun = (uint8_t)(conditions(board) & ~board->fault_bits);
    if (begun != 0) {
        trip(board, begun);
    } else if (!board->enabled) {
        board_hal_torque(0.0f, false); /* said again: a disturbed register does not stay so */
    }
}

/* What cannot be cleared yet. */
static uint8_t lasting(const board_t *board)
{
    uint8_t bits = board_hal_faults() & HARDWARE_FAULTS;
    if (over_current(board_hal_current())) {
        bits |= board->fault_bits & ERROR_OVERCURRENT;
    }
    float speed = motion_speed_rad_s(&board->motion, board->now_us, SLOW_CUT_US);
    if (magnitude(speed) > REST_SHARE * BOARD_OVERSPEED_RAD_S) {
        bits |= board->fault_bits & ERROR_OVERSPEED;
    }
    return bits;
}

static void clear(board_t *board)
{
    board->timed_out = false;
    board->fault_bits = lasting(board);
    board->fault = board->fault_bits != 0;
    switch_off(board, BECAUSE_CLEARED);
}

static void check_timeout(board_t *board)
{
    if (board->has_good && !board->timed_out && board->now_us - board->t_good_us >= TIMEOUT_US) {
        board->timed_out = true;
        switch_off(board, BECAUSE_TIMEOUT);
    }
}

uint8_t board_status(const board_t *board)
{
    return (uint8_t)((board->enabled ? STATUS_ENABLED : 0u) | (board->timed_out ? STATUS_TIMEOUT : 0u)
                     | (board->limited ? STATUS_LIMITED : 0u) | (board->fault ? STATUS_FAULT : 0u));
}

/* --- line ---------------------------------------------------------------------------------------------------------- */

/* An answer that finds no room is dropped as a whole. */
static void send(board_t *board, const answer_t *answer)
{
    if (board->sending_length + ANSWER_BYTES <= SENDING_BYTES) {
        encode_answer(answer, board->sending + board->sending_length);
        board->sending_length += ANSWER_BYTES;
    }
}

static void send_bytes(board_t *board)
{
    size_t sent = 0;
    while (sent < board->sending_length && board_hal_uart_put(board->sending[sent])) {
        sent++;
    }
    board->sending_length -= sent;
    for (size_t i = 0; sent > 0 && i < board->sending_length; i++) {
        board->sending[i] = board->sending[i + sent];
    }
}

static void answer_request(board_t *board, uint8_t seq)
{
    answer_t answer = {
        .seq = seq,
        .status = board_status(board),
        .errors = board->line_errors | board->fault_bits,
        .theta_rad = motion_theta_rad(&board->motion),
        .dtheta_rad_s = motion_speed_rad_s(&board->motion, board->now_us, SPEED_US),
        .current_a = board_hal_current(),
        .board_ms = (uint16_t)(board->now_us / 1000),
    };
    board->line_errors = 0;
    send(board, &answer);
}

static void act(board_t *board, const request_t *request)
{
    if (!is_number(request->torque_nm)) {
        trip(board, 0);
    } else if (request->clear_fault) {
        clear(board);
    } else if (!request->enable) {
        switch_off(board, BECAUSE_REQUEST);
    } else if (board->timed_out || board->fault) {
        switch_off(board, BECAUSE_REFUSED);
    } else {
        drive(board, request->torque_nm);
    }
}

static void obey(board_t *board, const request_t *request)
{
    board->has_good = true;
    board->t_good_us = board->t_byte_us; /* a frame behind rubbish is known for one only in the silence after it */
    if (board->has_seq && request->seq != (uint8_t)(board->seq + 1)) {
        board->line_errors |= ERROR_SEQ_GAP;
    }
    board->has_seq = true;
    board->seq = request->seq;
    act(board, request);
    answer_request(board, request->seq);
}

static void handle(board_t *board, decoded_t decoded)
{
    if (decoded.bad_crc) {
        board->line_errors |= ERROR_CRC;
    }
    if (decoded.has_request) {
        obey(board, &decoded.request);
    }
}

static void check_silence(board_t *board)
{
    if (board->decoder.length > 0 && board->now_us - board->t_byte_us >= PARTIAL_FRAME_US) {
        handle(board, decoder_silence(&board->decoder));
    }
}

static void receive(board_t *board)
{
    int byte = board_hal_uart_get();
    if (byte >= 0) {
        board->t_byte_us = board->now_us;
        handle(board, decoder_feed(&board->decoder, (uint8_t)byte));
    }
}

/* --- the loop ------------------------------------------------------------------------------------------------------ */

void board_start(board_t *board)
{
    *board = (board_t){.clock_us = board_hal_us(), .t_step_us = -LOOP_US};
    motion_start(&board->motion, 0, board_hal_encoder());
    switch_off(board, BECAUSE_START);
}

static void pass_time(board_t *board)
{
    uint32_t clock_us = board_hal_us();
    board->now_us += (uint32_t)(clock_us - board->clock_us); /* right across the clock's wrap */
    board->clock_us = clock_us;
}

void board_poll(board_t *board)
{
    pass_time(board);
    motion_update(&board->motion, board->now_us, board_hal_encoder());
    look(board);
    check_silence(board);
    check_timeout(board);
    step_torque(board);
    receive(board);
    send_bytes(board);
    board_hal_watchdog();
}
