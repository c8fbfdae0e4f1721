/* The hardware layer for an STM32F401 or F411 at 84 MHz: an example, built by `make stm32f4`.
 *
 * What it drives is a current controller with an analogue or PWM set value (10 to 90 % of the period is the whole range,
 * 50 % is nothing), an enable input and a ready output. FILL IN: whatever says so is of your board and of nobody else's.
 *
 *   PA8  TIM1_CH1   set value of the current, PWM of 20 kHz      PA9, PA10  USART1 to the Raspberry Pi
 *   PB1             enable of the power stage, high is on        PA6, PA7   TIM3, tracks A and B of the encoder
 *   PB0             ready of the power stage, low is a fault     PA0        ADC1_IN0, measured current
 */
#include "../board.h"
#include "../board_hal.h"
#include "../board_limits.h"
#include "registers.h"

#define CLOCK_HZ 84000000u
#define BAUD 115200u
#define PWM_HZ 20000u
#define PWM_STEPS (CLOCK_HZ / PWM_HZ)

/* FILL IN: the current that the power stage takes for 90 % of the period. */
#define CURRENT_RANGE_A 3.0f
/* FILL IN: the converter's reading without current, and what one step of it is (here 3.3 V over +-5 A). */
#define ADC_ZERO 2048
#define ADC_A_PER_STEP (10.0f / 4096.0f)
/* FILL IN: +1, or -1 where a positive torque must turn the set value, or the encoder, round. */
#define TORQUE_SIGN 1.0f
#define ENCODER_SIGN 1

#define ENABLE_PIN 1u /* of port B */
#define READY_PIN 0u

#define PIN_ALTERNATE 2u
#define PIN_OUTPUT 1u
#define PIN_ANALOGUE 3u
#define PULL_UP 1u
#define PULL_DOWN 2u

/* --- start --------------------------------------------------------------------------------------------------------- */

static void pin_mode(uint32_t port, uint32_t pin, uint32_t mode)
{
    GPIO_MODER(port) = (GPIO_MODER(port) & ~(3u << (2u * pin))) | mode << (2u * pin);
}

static void pin_pull(uint32_t port, uint32_t pin, uint32_t pull)
{
    GPIO_PUPDR(port) = (GPIO_PUPDR(port) & ~(3u << (2u * pin))) | pull << (2u * pin);
}

static void pin_function(uint32_t port, uint32_t pin, uint32_t function)
{
    uint32_t shift = 4u * (pin % 8u);
    GPIO_AFR(port, pin) = (GPIO_AFR(port, pin) & ~(15u << shift)) | function << shift;
    pin_mode(port, pin, PIN_ALTERNATE);
}

/* 16 MHz / 16 * 336 / 4 = 84 MHz; the slow bus gets half, its timers all of it. */
static void start_clock(void)
{
    FLASH_ACR = 2u | 7u << 8; /* two wait states at 84 MHz; caches and prefetch on */
    RCC_PLLCFGR = 16u | 336u << 6 | 1u << 16 | 7u << 24;
    RCC_CR |= 1u << 24;
    while ((RCC_CR & 1u << 25) == 0) {
    }
    RCC_CFGR = 4u << 10 | 2u;
    while ((RCC_CFGR & 3u << 2) != 2u << 2) {
    }
    RCC_AHB1ENR |= 3u; /* ports A and B */
    RCC_APB1ENR |= 1u << 0 | 1u << 1; /* TIM2, TIM3 */
    RCC_APB2ENR |= 1u << 0 | 1u << 4 | 1u << 8; /* TIM1, USART1, ADC1 */
}

static void start_pins(void)
{
    GPIO_BSRR(GPIOB) = 1u << (16u + ENABLE_PIN); /* off before it is an output */
    pin_mode(GPIOB, ENABLE_PIN, PIN_OUTPUT);
    pin_pull(GPIOB, READY_PIN, PULL_DOWN); /* a broken wire is a fault */
    pin_mode(GPIOA, 0, PIN_ANALOGUE);
    pin_function(GPIOA, 6, 2);
    pin_function(GPIOA, 7, 2);
    pin_pull(GPIOA, 6, PULL_UP);
    pin_pull(GPIOA, 7, PULL_UP);
    pin_function(GPIOA, 8, 1);
    pin_function(GPIOA, 9, 7);
    pin_function(GPIOA, 10, 7);
    pin_pull(GPIOA, 10, PULL_UP);
}

static void start_timers(void)
{
    TIM_PSC(TIM2) = CLOCK_HZ / 1000000u - 1u; /* the clock: 32 bits of us */
    TIM_ARR(TIM2) = 0xFFFFFFFFu;
    TIM_EGR(TIM2) = 1u;
    TIM_CR1(TIM2) = 1u;

    TIM_SMCR(TIM3) = 3u; /* the encoder: both edges of both tracks */
    TIM_CCMR1(TIM3) = 1u | 3u << 4 | 1u << 8 | 3u << 12; /* each filtered over eight clocks */
    TIM_ARR(TIM3) = 0xFFFFu;
    TIM_CR1(TIM3) = 1u;

    TIM_ARR(TIM1) = PWM_STEPS - 1u; /* the set value */
    TIM_CCMR1(TIM1) = 6u << 4 | 1u << 3;
    TIM_CCR1(TIM1) = PWM_STEPS / 2u;
    TIM_CCER(TIM1) = 1u;
    TIM_BDTR(TIM1) = 1u << 15;
    TIM_EGR(TIM1) = 1u;
    TIM_CR1(TIM1) = 1u << 7 | 1u;
}

static void start_line_and_converter(void)
{
    USART1_BRR = (CLOCK_HZ + BAUD / 2u) / BAUD;
    USART1_CR1 = 1u << 13 | 1u << 3 | 1u << 2;

    ADC_CCR = 1u << 16; /* 84 MHz / 4 */
    ADC1_SMPR2 = 3u;    /* channel 0, 56 clocks: some 300,000 readings a second */
    ADC1_SQR3 = 0u;
    ADC1_CR2 = 1u << 1 | 1u; /* on, one reading after the other */
    uint32_t t_us = TIM_CNT(TIM2);
    while (TIM_CNT(TIM2) - t_us < 10u) { /* it needs 3 us to settle */
    }
    ADC1_CR2 |= 1u << 30;
}

/* Its own oscillator of about 32 kHz: 32000 / 16 * 50 ms = 100 steps. It cannot be stopped again. */
static void start_watchdog(void)
{
    IWDG_KR = 0xCCCCu;
    IWDG_KR = 0x5555u;
    IWDG_PR = 2u;
    IWDG_RLR = 100u;
    while (IWDG_SR != 0) {
    }
    IWDG_KR = 0xAAAAu;
}

/* --- the eight functions ------------------------------------------------------------------------------------------- */

uint32_t board_hal_us(void)
{
    return TIM_CNT(TIM2);
}

int board_hal_uart_get(void)
{
    /* reading the status and then the data clears an overrun or a framing error, too; the CRC finds what it spoilt */
    return (USART1_SR & (1u << 5 | 1u << 3)) != 0 ? (int)(USART1_DR & 0xFFu) : -1;
}

bool board_hal_uart_put(uint8_t byte)
{
    if ((USART1_SR & 1u << 7) == 0) {
        return false;
    }
    USART1_DR = byte;
    return true;
}

void board_hal_torque(float torque_nm, bool on)
{
    /* current = torque / torque constant; share of the period = 0.5 + 0.4 * current / range */
    float current_a = on ? TORQUE_SIGN * torque_nm / BOARD_TORQUE_CONSTANT_NM_PER_A : 0.0f;
    float share = 0.5f + 0.4f * current_a / CURRENT_RANGE_A;
    share = share < 0.1f ? 0.1f : share > 0.9f ? 0.9f : share;
    TIM_CCR1(TIM1) = (uint32_t)(share * (float)PWM_STEPS);
    GPIO_BSRR(GPIOB) = on ? 1u << ENABLE_PIN : 1u << (16u + ENABLE_PIN);
}

uint16_t board_hal_encoder(void)
{
    int32_t counter = (int32_t)(TIM_CNT(TIM3) & 0xFFFFu);
    return (uint16_t)(ENCODER_SIGN * counter);
}

float board_hal_current(void)
{
    return TORQUE_SIGN * (float)((int32_t)(ADC1_DR & 0xFFFu) - ADC_ZERO) * ADC_A_PER_STEP;
}

uint8_t board_hal_faults(void)
{
    /* FILL IN: a supply that is measured, an encoder that tells of its own trouble. A driver is not ready for several
     * reasons; most of them are its current. */
    return (GPIO_IDR(GPIOB) & 1u << READY_PIN) == 0 ? ERROR_OVERCURRENT : 0u;
}

void board_hal_watchdog(void)
{
    IWDG_KR = 0xAAAAu;
}

int main(void);

int main(void)
{
    static board_t board;
    start_clock();
    start_pins();
    start_timers();
    start_line_and_converter();
    start_watchdog();
    board_start(&board);
    for (;;) {
        board_poll(&board);
    }
}
