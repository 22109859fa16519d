/* From reset to main, for a Cortex-M with a floating-point unit. */
#include "board.h"

#define RESET_CONTROL (*(volatile uint32_t *)0xE000ED0C)
#define COPROCESSORS (*(volatile uint32_t *)0xE000ED88)

extern uint32_t stack_end, data_start, data_end, data_load, bss_start, bss_end; /* of the linker */

int main(void);

static void begin(void)
{
    const uint32_t *from = &data_load;
    uint32_t *to;
    /* Before any function that uses the unit. */
    COPROCESSORS |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    for (to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    main();
}

/* A bug, or a stack that is too small: after a reset the firmware gives no torque until it is begun again. */
static void fault(void)
{
    RESET_CONTROL = 0x05FA0004;
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const struct {
    const uint32_t *stack;
    void (*handlers[16 + BOARD_SERIAL_IRQ])(void); /* from exception 1 on; what is not enabled stays 0 */
} vectors = {
    &stack_end,
    {begin, fault, fault, fault, fault, fault, [14] = board_tick_interrupt,
     [15 + BOARD_SERIAL_IRQ] = board_serial_interrupt},
};
