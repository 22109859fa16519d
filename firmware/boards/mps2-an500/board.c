/* Arm MPS2 with the image AN500: a Cortex-M7 whose floating-point unit has double precision. */
#include "board.h"

#include "cortex.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define TIMER0_CONTROL REGISTER(0x40000000)
#define TIMER0_VALUE REGISTER(0x40000004)
#define TIMER0_RELOAD REGISTER(0x40000008)
#define UART0 0x40004000u
#define UART1 0x40005000u
#define DATA(port) REGISTER((port) + 0x00)
#define STATE(port) REGISTER((port) + 0x04)
#define CONTROL(port) REGISTER((port) + 0x08)
#define CLEAR(port) REGISTER((port) + 0x0C)
#define DIVIDER(port) REGISTER((port) + 0x10)

enum { FULL = 1 << 0, RECEIVED = 1 << 1 };                     /* of STATE and CLEAR */
enum { SENDS = 1 << 0, RECEIVES = 1 << 1, INTERRUPTS = 1 << 3 }; /* of CONTROL */
enum { UART0_INTERRUPT = 0, BAUD_RATE = 921600 };

const uint32_t board_clock = 25000000;

void board_begin(void)
{
    TIMER0_RELOAD = UINT32_MAX;
    TIMER0_VALUE = UINT32_MAX;
    TIMER0_CONTROL = 1;
    DIVIDER(UART0) = board_clock / BAUD_RATE;
    DIVIDER(UART1) = board_clock / BAUD_RATE;
    CONTROL(UART0) = SENDS | RECEIVES | INTERRUPTS;
    CONTROL(UART1) = SENDS;
    cortex_enable(UART0_INTERRUPT);
}

static void send(uint32_t port, uint8_t byte)
{
    while (STATE(port) & FULL) {
    }
    DATA(port) = byte;
}

void board_send(uint8_t byte)
{
    send(UART0, byte);
}

void board_trace(uint8_t byte)
{
    send(UART1, byte);
}

void board_interrupt(void)
{
    CLEAR(UART0) = RECEIVED;
    if (STATE(UART0) & RECEIVED) {
        cortex_received((uint8_t)DATA(UART0));
    }
}

uint32_t board_count(void)
{
    /* It counts down. */
    return ~TIMER0_VALUE;
}
