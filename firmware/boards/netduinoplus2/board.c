/* Netduino Plus 2: STM32F405, a Cortex-M4F at 168 MHz. QEMU has neither its clock tree nor its pins: on the board they come
 * first in `board_begin`. */
#include "board.h"

#include "cortex.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define TIMER2_CONTROL REGISTER(0x40000000)
#define TIMER2_COUNT REGISTER(0x40000024)
#define USART1 0x40011000u
#define USART2 0x40004400u
#define STATUS(port) REGISTER((port) + 0x00)
#define DATA(port) REGISTER((port) + 0x04)
#define BAUD(port) REGISTER((port) + 0x08)
#define CONTROL(port) REGISTER((port) + 0x0C)

enum { RECEIVED = 1 << 5, SENDABLE = 1 << 7 };                                        /* of STATUS */
enum { RECEIVES = 1 << 2, SENDS = 1 << 3, INTERRUPTS = 1 << 5, ENABLED = 1 << 13 };   /* of CONTROL */
enum { USART1_INTERRUPT = 37, USART1_CLOCK = 84000000, BAUD_RATE = 921600 };

const uint32_t board_clock = 168000000;

void board_begin(void)
{
    TIMER2_CONTROL = 1;
    BAUD(USART1) = USART1_CLOCK / BAUD_RATE;
    CONTROL(USART1) = ENABLED | SENDS | RECEIVES | INTERRUPTS;
    CONTROL(USART2) = ENABLED | SENDS;
    cortex_enable(USART1_INTERRUPT);
}

static void send(uint32_t port, uint8_t byte)
{
    while (!(STATUS(port) & SENDABLE)) {
    }
    DATA(port) = byte;
}

void board_send(uint8_t byte)
{
    send(USART1, byte);
}

void board_trace(uint8_t byte)
{
    send(USART2, byte);
}

void board_interrupt(void)
{
    if (STATUS(USART1) & RECEIVED) {
        cortex_received((uint8_t)DATA(USART1));
    }
}

uint32_t board_count(void)
{
    return TIMER2_COUNT;
}
