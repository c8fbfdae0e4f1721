/* The hardware as the firmware sees it: eight functions, none of which waits.
 *
 * host/host.c has them for a simulated clock, stm32f4/hal.c as an example for a microcontroller. */
#ifndef BOARD_HAL_H
#define BOARD_HAL_H

#include <stdbool.h>
#include <stdint.h>

/* A free-running clock in us; it may wrap after 2^32 us, and is read at least once in that time. */
uint32_t board_hal_us(void);

/* The next byte that came in, or -1. */
int board_hal_uart_get(void);

/* Give one byte to the line; false while it takes none. */
bool board_hal_uart_put(uint8_t byte);

/* The motor's torque from now on. `on` false: the power stage is switched off, whatever the torque says. */
void board_hal_torque(float torque_nm, bool on);

/* The encoder's counter; it wraps at 16 bits. It counts up where a positive torque turns the hoop to. */
uint16_t board_hal_encoder(void);

/* Measured motor current in A; its sign is that of the torque. */
float board_hal_current(void);

/* ERROR_OVERCURRENT, ERROR_ENCODER and ERROR_SUPPLY as far as the hardware tells of them now. */
uint8_t board_hal_faults(void);

/* The main loop is alive: the independent watchdog begins anew. */
void board_hal_watchdog(void);

#endif
