/* What the firmware needs from a board: replace board.c, board.h and board.ld for another one. */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

enum { BOARD_SERIAL_IRQ = 37 }; /* USART1 */

/* Starts the tick, the counter and the serial ports. */
void board_begin(void);

/* Sleeps until an interrupt, unless there is one already. */
void board_sleep(void);

/* The next byte of the link, -1 if there is none. */
int board_read(void);

void board_write(const uint8_t *bytes, size_t count);

/* A word on the second serial port, for measurements. */
void board_trace(uint32_t word);

/* Time since the start, which wraps. */
uint32_t board_milliseconds(void);

/* A free counter for measurements, which wraps: instructions under `qemu -icount shift=0`. */
uint32_t board_count(void);

void board_tick_interrupt(void);
void board_serial_interrupt(void);

#endif
