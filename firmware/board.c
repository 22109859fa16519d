/* STM32F405 of a Netduino Plus 2, as far as QEMU has it: no clock tree, no pins. */
#include "board.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))

enum { CORE_HZ = 168000000, SERIAL_HZ = 84000000, BAUD = 921600 };

/* SysTick and the interrupt controller are in every Cortex-M. */
#define SYSTICK_CONTROL REGISTER(0xE000E010)
#define SYSTICK_RELOAD REGISTER(0xE000E014)
#define SYSTICK_VALUE REGISTER(0xE000E018)
#define INTERRUPT_ENABLE(word) REGISTER(0xE000E100 + 4 * (word))

#define TIMER2_CONTROL REGISTER(0x40000000)
#define TIMER2_COUNT REGISTER(0x40000024)

#define LINK_PORT 0x40011000u  /* USART1 */
#define TRACE_PORT 0x40004400u /* USART2 */
#define SERIAL_STATUS(port) REGISTER((port) + 0x00)
#define SERIAL_DATA(port) REGISTER((port) + 0x04)
#define SERIAL_BAUD(port) REGISTER((port) + 0x08)
#define SERIAL_CONTROL(port) REGISTER((port) + 0x0C)

enum { RECEIVED = 1 << 5, SENDABLE = 1 << 7, RECEIVES = 1 << 2, SENDS = 1 << 3, INTERRUPTS = 1 << 5, ENABLED = 1 << 13 };

static volatile uint32_t milliseconds;

/* Bytes that came during a control step: a power of two, two frames of the link or more. */
static volatile uint8_t ring[512];
static volatile uint32_t written;
static uint32_t read;

void board_begin(void)
{
    SYSTICK_RELOAD = CORE_HZ / 1000 - 1;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7; /* the core's clock, with interrupts */
    TIMER2_CONTROL = 1;
    SERIAL_BAUD(LINK_PORT) = SERIAL_HZ / BAUD;
    SERIAL_CONTROL(LINK_PORT) = ENABLED | SENDS | RECEIVES | INTERRUPTS;
    SERIAL_CONTROL(TRACE_PORT) = ENABLED | SENDS;
    INTERRUPT_ENABLE(BOARD_SERIAL_IRQ / 32) = 1u << BOARD_SERIAL_IRQ % 32;
}

void board_sleep(void)
{
    /* With interrupts masked none is lost between the test and the sleep, which a pending one ends all the same. */
    __asm volatile("cpsid i" ::: "memory");
    if (read == written) {
        __asm volatile("wfi");
    }
    __asm volatile("cpsie i" ::: "memory");
}

int board_read(void)
{
    return read == written ? -1 : ring[read++ % sizeof ring];
}

static void send(uint32_t port, uint8_t byte)
{
    while (!(SERIAL_STATUS(port) & SENDABLE)) {
    }
    SERIAL_DATA(port) = byte;
}

void board_write(const uint8_t *bytes, size_t count)
{
    while (count--) {
        send(LINK_PORT, *bytes++);
    }
}

void board_trace(uint32_t word)
{
    int i;
    for (i = 0; i < 4; i++) {
        send(TRACE_PORT, (uint8_t)(word >> 8 * i));
    }
}

uint32_t board_milliseconds(void)
{
    return milliseconds;
}

uint32_t board_count(void)
{
    return TIMER2_COUNT;
}

void board_tick_interrupt(void)
{
    milliseconds++;
}

void board_serial_interrupt(void)
{
    /* Without room a byte is lost, and with it a frame, which its check sum shows. */
    if (SERIAL_STATUS(LINK_PORT) & RECEIVED) {
        const uint8_t byte = (uint8_t)SERIAL_DATA(LINK_PORT);
        if (written - read < sizeof ring) {
            ring[written++ % sizeof ring] = byte;
        }
    }
}
