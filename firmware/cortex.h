/* What every Cortex-M has: the start, a tick, and bytes that wait for the main loop. */
#ifndef CORTEX_H
#define CORTEX_H

#include <stdint.h>

enum { CORTEX_INTERRUPTS = 96 }; /* of the board at most */

/* Time since `cortex_begin`, which wraps. */
uint32_t cortex_milliseconds(void);

/* Begins the tick. */
void cortex_begin(uint32_t clock);

/* Lets interrupt `number` of the board call `board_interrupt`. */
void cortex_enable(int number);

/* Keeps a byte; called in an interrupt. */
void cortex_received(uint8_t byte);

/* The next byte; -1 without one, after the next interrupt. */
int cortex_next(void);

#endif
