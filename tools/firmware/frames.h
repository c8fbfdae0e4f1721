/* Frames of the line: bytes to requests, answers to bytes. The tables are in docs/reference/board.md. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define REQUEST_SYNC 0xA5u
#define ANSWER_SYNC 0x5Au
#define REQUEST_BYTES 8u
#define ANSWER_BYTES 20u

#define FLAG_ENABLE 0x01u
#define FLAG_CLEAR_FAULT 0x02u

#define STATUS_ENABLED 0x01u
#define STATUS_TIMEOUT 0x02u
#define STATUS_LIMITED 0x04u
#define STATUS_FAULT 0x08u

#define ERROR_CRC 0x01u
#define ERROR_SEQ_GAP 0x02u
#define ERROR_OVERCURRENT 0x04u
#define ERROR_ENCODER 0x08u
#define ERROR_SUPPLY 0x10u
#define ERROR_OVERSPEED 0x20u

typedef struct {
    uint8_t seq;
    bool enable;
    bool clear_fault;
    float torque_nm;
} request_t;

typedef struct {
    uint8_t seq;
    uint8_t status;
    uint8_t errors;
    float theta_rad;
    float dtheta_rad_s;
    float current_a;
    uint16_t board_ms;
} answer_t;

/* What waits for more bytes. All zero is a decoder that expects a frame to begin. */
typedef struct {
    uint8_t buffer[2 * REQUEST_BYTES];
    size_t length;
    size_t grid;    /* offset in the buffer at which the next frame is due */
    size_t charged; /* bytes at the buffer's head that a bad CRC has accounted for */
} decoder_t;

/* What a byte, or silence, completed. */
typedef struct {
    bool has_request;
    bool bad_crc;
    request_t request;
} decoded_t;

uint8_t crc8(const uint8_t *data, size_t length);
uint16_t crc16(const uint8_t *data, size_t length);

/* One byte came in. */
decoded_t decoder_feed(decoder_t *decoder, uint8_t byte);

/* The line fell silent: a held frame is released, a partial one dropped, a frame begins next. */
decoded_t decoder_silence(decoder_t *decoder);

void encode_answer(const answer_t *answer, uint8_t bytes[ANSWER_BYTES]);

#endif
