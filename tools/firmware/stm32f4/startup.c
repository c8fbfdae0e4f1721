/* What runs before main: vectors, memory, and the two functions that the compiler itself may call. */
#include <stddef.h>
#include <stdint.h>

#define VECTORS 16u /* no interrupt is used: everything is polled */
#define COPROCESSOR_ACCESS (*(volatile uint32_t *)0xE000ED88u)

extern uint32_t stack_top, data_source, data_start, data_end, bss_start, bss_end;

int main(void);
void reset_handler(void);
void stop_handler(void);
void *memcpy(void *to, const void *from, size_t length);
void *memset(void *to, int value, size_t length);

void *memcpy(void *to, const void *from, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        ((volatile uint8_t *)to)[i] = ((const uint8_t *)from)[i];
    }
    return to;
}

void *memset(void *to, int value, size_t length)
{
    for (size_t i = 0; i < length; i++) {
        ((volatile uint8_t *)to)[i] = (uint8_t)value;
    }
    return to;
}

/* A fault of the processor: nothing kicks the watchdog any more, which resets all within 50 ms; the outputs go with it. */
void stop_handler(void)
{
    for (;;) {
    }
}

void reset_handler(void)
{
    COPROCESSOR_ACCESS |= 0xFu << 20; /* the floating-point unit, before anything uses it */
    uint32_t *from = &data_source;
    for (uint32_t *to = &data_start; to < &data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end; to++) {
        *to = 0;
    }
    (void)main();
    stop_handler();
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[VECTORS] = {
    (uintptr_t)&stack_top,    (uintptr_t)&reset_handler, (uintptr_t)&stop_handler, (uintptr_t)&stop_handler,
    (uintptr_t)&stop_handler, (uintptr_t)&stop_handler,  (uintptr_t)&stop_handler, 0,
    0,                        0,                         0,                        (uintptr_t)&stop_handler,
    (uintptr_t)&stop_handler, 0,                         (uintptr_t)&stop_handler, (uintptr_t)&stop_handler,
};
