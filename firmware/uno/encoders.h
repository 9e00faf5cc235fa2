/* Count the edges of two wheels: quadrature (four counts a period) or one channel (two, signed by the duty). */
#pragma once
#include <stdint.h>

extern uint8_t encoders_fault; /* a wheel did not count for half a second of strong drive */

void encoders_edge(uint8_t pins); /* by the interrupt; bits 0 to 3: A left, A right, B left, B right */
void encoders_tick(void);         /* writes the counts into the telemetry */
