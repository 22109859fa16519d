#include "cortex.h"

#include "board.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010)
#define SYSTICK_RELOAD REGISTER(0xE000E014)
#define INTERRUPT_ENABLE(word) REGISTER(0xE000E100 + 4 * (word))
#define RESET_CONTROL REGISTER(0xE000ED0C)
#define COPROCESSORS REGISTER(0xE000ED88)

extern uint32_t stack_end, data_start, data_end, data_load, bss_start, bss_end; /* of board.ld */

static volatile uint32_t milliseconds;

/* Bytes that came during a control step: a power of two, and more than two frames. */
static volatile uint8_t ring[512];
static volatile uint32_t written;
static uint32_t read;

int main(void);

static void begin(void)
{
    const uint32_t *from = &data_load;
    uint32_t *to;
    /* The floating-point unit, before any function that uses it. */
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

/* A bug, or a stack that is too small. After the reset no torque leaves until the next episode. */
static void fault(void)
{
    RESET_CONTROL = 0x05FA0004;
    for (;;) {
    }
}

static void tick(void)
{
    milliseconds++;
}

/* What is not here is never enabled. */
__attribute__((section(".vectors"), used)) static const struct {
    const uint32_t *stack;
    void (*handlers[15 + CORTEX_INTERRUPTS])(void);
} vectors = {&stack_end, {begin, fault, fault, fault, fault, fault, [14] = tick, [15 ... 14 + CORTEX_INTERRUPTS] = board_interrupt}};

void cortex_begin(uint32_t clock)
{
    SYSTICK_RELOAD = clock / 1000 - 1;
    SYSTICK_CONTROL = 7; /* with the core's clock and interrupts */
}

uint32_t cortex_milliseconds(void)
{
    return milliseconds;
}

void cortex_enable(int number)
{
    INTERRUPT_ENABLE(number / 32) = 1u << number % 32;
}

void cortex_received(uint8_t byte)
{
    /* Without room it is lost, and its frame with it, as the checksum shows. */
    if (written - read < sizeof ring) {
        ring[written++ % sizeof ring] = byte;
    }
}

int cortex_next(void)
{
    if (read != written) {
        return ring[read++ % sizeof ring];
    }
    /* An interrupt after the test is pending, and ends the sleep. */
    __asm volatile("cpsid i" ::: "memory");
    if (read == written) {
        __asm volatile("wfi");
    }
    __asm volatile("cpsie i" ::: "memory");
    return -1;
}
