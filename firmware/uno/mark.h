/* The lap mark: a reflectance sensor on one pin sees a strip of tape. Stamped at its first edge. */
#pragma once
#include <stdint.h>

extern uint8_t mark_on; /* over the strip now */

void mark_edge(uint8_t level); /* from the interrupt */
void mark_tick(void);
