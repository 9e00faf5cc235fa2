/* Detect the lap mark: a reflectance sensor on one pin detects a strip of tape, with the time of its first edge. */
#pragma once
#include <stdint.h>

extern uint8_t mark_on; /* 1: over the strip */

void mark_edge(uint8_t level); /* by the interrupt */
void mark_tick(void);
