/* The firmware on a simulated clock: lines in, lines out. docs/guides/firmware.md has the table of words.
 *
 * The clock stands still between two lines; sensors are what the last `plant` said, carried on by its speed. Whoever
 * simulates the plant moves it between two lines, with the torque that the firmware gave. */
#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../board.h"
#include "../board_hal.h"
#include "../board_limits.h"

/* How often the main loop comes round: a tenth of what a byte takes. */
#define POLL_US 10
#define LINE_BYTES 4096

static const double TURN_RAD = 6.283185307179586;

static struct {
    uint32_t clock_us; /* of the hardware's clock at time zero */
    uint64_t now_us;
    uint64_t t_plant_us;
    double theta_rad, dtheta_rad_s, current_a;
    uint8_t faults;
    float torque_nm;
    int incoming;
    uint8_t outgoing[SENDING_BYTES];
    size_t outgoing_length;
} rig = {.incoming = -1, .current_a = NAN};

static board_t board;
static bool started;
static uint32_t told; /* how many of the board's torques were written out */

/* --- hardware ------------------------------------------------------------------------------------------------------ */

uint32_t board_hal_us(void)
{
    return rig.clock_us + (uint32_t)rig.now_us;
}

int board_hal_uart_get(void)
{
    int byte = rig.incoming;
    rig.incoming = -1;
    return byte;
}

bool board_hal_uart_put(uint8_t byte)
{
    if (rig.outgoing_length == sizeof rig.outgoing) {
        return false;
    }
    rig.outgoing[rig.outgoing_length++] = byte;
    return true;
}

void board_hal_torque(float torque_nm, bool on)
{
    rig.torque_nm = on ? torque_nm : 0.0f;
}

uint16_t board_hal_encoder(void)
{
    double theta = rig.theta_rad + rig.dtheta_rad_s * 1e-6 * (double)(rig.now_us - rig.t_plant_us);
    return (uint16_t)(int64_t)floor(theta / (TURN_RAD / BOARD_COUNTS_PER_TURN));
}

float board_hal_current(void)
{
    /* current = torque / torque constant, where nobody says another one */
    return isnan(rig.current_a) ? rig.torque_nm / BOARD_TORQUE_CONSTANT_NM_PER_A : (float)rig.current_a;
}

uint8_t board_hal_faults(void)
{
    return rig.faults;
}

void board_hal_watchdog(void)
{
}

/* --- lines --------------------------------------------------------------------------------------------------------- */

static const char *const WORDS[] = {"start", "request", "slew", "cleared", "refused", "timeout", "fault"};

/* What was given to the motor, then what was given to the line. */
static bool tell(void)
{
    bool moved = board.applied != told;
    if (moved) {
        printf("torque %.9g %d %s\n", (double)rig.torque_nm, board.enabled, WORDS[board.because]);
    }
    if (rig.outgoing_length > 0) {
        printf("tx ");
        for (size_t i = 0; i < rig.outgoing_length; i++) {
            printf("%02x", rig.outgoing[i]);
        }
        printf("\n");
    }
    told = board.applied;
    rig.outgoing_length = 0;
    return moved;
}

static void done(void)
{
    printf("at %" PRIu64 " %u %u\n", rig.now_us, board_status(&board), board.fault_bits);
    fflush(stdout);
}

/* On to this time, or to the first torque before it. */
static void run(uint64_t until_us)
{
    while (rig.now_us < until_us) {
        uint64_t next_us = (rig.now_us / POLL_US + 1) * POLL_US;
        rig.now_us = next_us < until_us ? next_us : until_us;
        board_poll(&board);
        if (tell()) {
            break;
        }
    }
    done();
}

/* Bytes come in now. */
static bool receive(const char *text)
{
    unsigned int byte;
    for (; sscanf(text, "%2x", &byte) == 1 && strlen(text) >= 2; text += 2) {
        rig.incoming = (int)byte;
        board_poll(&board);
        (void)tell();
    }
    done();
    return *text == '\0';
}

/* Power on, and again; before it there are only `plant` and `clock`. */
static void start(void)
{
    started = true;
    board_start(&board);
    told = board.applied - 1;
    (void)tell();
    done();
}

static bool obey_line(const char *line)
{
    char text[LINE_BYTES] = "";
    uint64_t until_us;
    double theta, dtheta, current;
    unsigned int faults;
    if (sscanf(line, "plant %lf %lf %lf %u", &theta, &dtheta, &current, &faults) == 4) {
        rig.t_plant_us = rig.now_us;
        rig.theta_rad = theta;
        rig.dtheta_rad_s = dtheta;
        rig.current_a = current;
        rig.faults = (uint8_t)faults;
        return isfinite(theta) && isfinite(dtheta);
    }
    if (started && sscanf(line, "run %" SCNu64, &until_us) == 1) {
        run(until_us);
        return true;
    }
    if (started && sscanf(line, "rx %4095s", text) == 1) {
        return receive(text);
    }
    if (sscanf(line, "clock %" SCNu32, &rig.clock_us) == 1) {
        return !started;
    }
    if (strcmp(line, "start") == 0) {
        start();
        return true;
    }
    return false;
}

int main(void)
{
    static char line[LINE_BYTES];
    while (fgets(line, sizeof line, stdin) != NULL) {
        line[strcspn(line, "\r\n")] = '\0';
        if (!obey_line(line)) {
            fprintf(stderr, "not understood: %.60s\n", line);
            return 2;
        }
    }
    return 0;
}
