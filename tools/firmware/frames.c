#include "frames.h"

/* --- checksums ---------------------------------------------------------------------------------------------------- */

uint8_t crc8(const uint8_t *data, size_t length)
{
    uint8_t crc = 0x00;
    for (size_t i = 0; i < length; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc << 1) ^ ((crc & 0x80u) ? 0x07u : 0u));
        }
    }
    return crc;
}

uint16_t crc16(const uint8_t *data, size_t length)
{
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < length; i++) {
        crc = (uint16_t)(crc ^ (data[i] << 8));
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000u) ? 0x1021u : 0u));
        }
    }
    return crc;
}

/* --- numbers: low byte first, whatever the processor does ---------------------------------------------------------- */

typedef union {
    float number;
    uint32_t bits;
} float_bits_t;

static float get_f32(const uint8_t *bytes)
{
    float_bits_t value = {0};
    for (size_t i = 0; i < 4; i++) {
        value.bits |= (uint32_t)bytes[i] << (8 * i);
    }
    return value.number;
}

static void put_u16(uint8_t *bytes, uint16_t value)
{
    bytes[0] = (uint8_t)value;
    bytes[1] = (uint8_t)(value >> 8);
}

static void put_f32(uint8_t *bytes, float number)
{
    float_bits_t value = {.number = number};
    for (size_t i = 0; i < 4; i++) {
        bytes[i] = (uint8_t)(value.bits >> (8 * i));
    }
}

void encode_answer(const answer_t *answer, uint8_t bytes[ANSWER_BYTES])
{
    bytes[0] = ANSWER_SYNC;
    bytes[1] = answer->seq;
    bytes[2] = answer->status;
    bytes[3] = answer->errors;
    put_f32(bytes + 4, answer->theta_rad);
    put_f32(bytes + 8, answer->dtheta_rad_s);
    put_f32(bytes + 12, answer->current_a);
    put_u16(bytes + 16, answer->board_ms);
    put_u16(bytes + 18, crc16(bytes, ANSWER_BYTES - 2));
}

/* --- requests ------------------------------------------------------------------------------------------------------ *
 *
 * A frame is taken at once where the previous one, or silence, lets it begin: on the grid. Off the grid, a frame that
 * verifies is held while a sync byte inside it may begin another one that verifies too; of two the one on the grid is
 * taken, or neither. So the tail of a damaged frame and the head of the next do not pass for a frame. */

static request_t read_request(const uint8_t *bytes)
{
    return (request_t){
        .seq = bytes[1],
        .enable = (bytes[2] & FLAG_ENABLE) != 0,
        .clear_fault = (bytes[2] & FLAG_CLEAR_FAULT) != 0,
        .torque_nm = get_f32(bytes + 3),
    };
}

static bool verifies(const decoder_t *decoder, size_t start)
{
    const uint8_t *bytes = decoder->buffer + start;
    return bytes[0] == REQUEST_SYNC && crc8(bytes, REQUEST_BYTES - 1) == bytes[REQUEST_BYTES - 1];
}

/* Offset of the first byte at or after `start` that may begin a frame; the buffer's length when there is none. */
static size_t find_sync(const decoder_t *decoder, size_t start)
{
    while (start < decoder->length && decoder->buffer[start] != REQUEST_SYNC) {
        start++;
    }
    return start < decoder->length ? start : decoder->length;
}

static void drop(decoder_t *decoder, size_t count)
{
    decoder->length -= count;
    for (size_t i = 0; i < decoder->length; i++) {
        decoder->buffer[i] = decoder->buffer[i + count];
    }
}

/* Step over bytes that are no frame. */
static void skip(decoder_t *decoder, size_t count)
{
    decoder->charged -= count < decoder->charged ? count : decoder->charged;
    decoder->grid = (decoder->grid + 2 * REQUEST_BYTES - count) % REQUEST_BYTES;
    drop(decoder, count);
}

/* Tell of the frame at the head once, and go on with the search inside it. */
static void reject(decoder_t *decoder, decoded_t *decoded)
{
    if (decoder->charged == 0) {
        decoded->bad_crc = true;
        decoder->charged = REQUEST_BYTES;
    }
    skip(decoder, 1);
}

static void accept(decoder_t *decoder, decoded_t *decoded)
{
    decoded->request = read_request(decoder->buffer);
    decoded->has_request = true;
    drop(decoder, REQUEST_BYTES);
    decoder->grid = decoder->charged = 0;
}

/* Decide on a frame off the grid; false while it must wait for the bytes that overlap it. */
static bool settle(decoder_t *decoder, bool final, decoded_t *decoded)
{
    size_t first_valid = 0;
    bool due_is_valid = false;
    for (size_t rival = find_sync(decoder, 1); rival < REQUEST_BYTES && rival < decoder->length;
         rival = find_sync(decoder, rival + 1)) {
        bool whole = rival + REQUEST_BYTES <= decoder->length;
        if (!whole && !final) {
            return false;
        }
        if (whole && verifies(decoder, rival)) {
            first_valid = first_valid == 0 ? rival : first_valid;
            due_is_valid = due_is_valid || rival == decoder->grid;
        }
    }
    if (first_valid == 0) {
        accept(decoder, decoded);
    } else {
        skip(decoder, due_is_valid ? decoder->grid : first_valid + 1);
    }
    return true;
}

/* Work off the buffer's head until it waits for more bytes. At most one request comes of it: less than two are held. */
static void scan(decoder_t *decoder, bool final, decoded_t *decoded)
{
    while (decoder->length > 0) {
        skip(decoder, find_sync(decoder, 0));
        if (decoder->length < REQUEST_BYTES) {
            return;
        }
        if (!verifies(decoder, 0)) {
            reject(decoder, decoded);
        } else if (decoder->grid == 0) {
            accept(decoder, decoded);
        } else if (!settle(decoder, final, decoded)) {
            return;
        }
    }
}

decoded_t decoder_feed(decoder_t *decoder, uint8_t byte)
{
    decoded_t decoded = {0};
    decoder->buffer[decoder->length++] = byte;
    scan(decoder, false, &decoded);
    return decoded;
}

decoded_t decoder_silence(decoder_t *decoder)
{
    decoded_t decoded = {0};
    scan(decoder, true, &decoded);
    *decoder = (decoder_t){0};
    return decoded;
}
