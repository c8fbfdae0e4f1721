/* Checksums and frames by themselves, for whoever compares them with docs/reference/board.md.
 *
 *   crc8 HEX, crc16 HEX                                   the checksum
 *   request HEX                                           seq enable clear torque, or nothing
 *   answer SEQ STATUS ERRORS THETA DTHETA CURRENT MS      its bytes */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "../frames.h"

#define LINE_BYTES 512

static size_t read_bytes(const char *text, uint8_t bytes[LINE_BYTES])
{
    size_t length = 0;
    unsigned int byte;
    for (; sscanf(text, "%2x", &byte) == 1; text += 2) {
        bytes[length++] = (uint8_t)byte;
    }
    return length;
}

static void decode(const uint8_t *bytes, size_t length)
{
    decoder_t decoder = {0};
    for (size_t i = 0; i < length; i++) {
        decoded_t decoded = decoder_feed(&decoder, bytes[i]);
        if (decoded.has_request) {
            printf("%d %d %d %.9g", decoded.request.seq, decoded.request.enable, decoded.request.clear_fault,
                   (double)decoded.request.torque_nm);
        }
    }
    printf("\n");
}

static void encode(const char *numbers)
{
    unsigned int seq, status, errors, ms;
    float theta, dtheta, current;
    uint8_t bytes[ANSWER_BYTES];
    if (sscanf(numbers, "%u %u %u %f %f %f %u", &seq, &status, &errors, &theta, &dtheta, &current, &ms) != 7) {
        return;
    }
    answer_t answer = {(uint8_t)seq, (uint8_t)status, (uint8_t)errors, theta, dtheta, current, (uint16_t)ms};
    encode_answer(&answer, bytes);
    for (size_t i = 0; i < ANSWER_BYTES; i++) {
        printf("%02x", bytes[i]);
    }
    printf("\n");
}

int main(void)
{
    char line[LINE_BYTES], word[LINE_BYTES], text[LINE_BYTES];
    uint8_t bytes[LINE_BYTES];
    while (fgets(line, sizeof line, stdin) != NULL) {
        if (sscanf(line, "%511s %511s", word, text) != 2) {
            return 2;
        }
        size_t length = read_bytes(text, bytes);
        if (strcmp(word, "crc8") == 0) {
            printf("%d\n", crc8(bytes, length));
        } else if (strcmp(word, "crc16") == 0) {
            printf("%d\n", crc16(bytes, length));
        } else if (strcmp(word, "request") == 0) {
            decode(bytes, length);
        } else if (strcmp(word, "answer") == 0) {
            encode(line + strlen("answer"));
        } else {
            return 2;
        }
    }
    return 0;
}
