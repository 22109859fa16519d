/* What a board is: a folder of boards/ with board.c, board.ld and board.mk. A lab writes these for its own. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* Of the core, Hz. */
extern const uint32_t board_clock;

/* Begins the ports and the counter. */
void board_begin(void);

/* Sends a byte over the link, or over a second port for measurements. Waits for room. */
void board_send(uint8_t byte);
void board_trace(uint8_t byte);

/* Every interrupt that `board_begin` has enabled. Calls `cortex_received` with each byte of the link. */
void board_interrupt(void);

/* A counter for measurements, which wraps. */
uint32_t board_count(void);

#endif
