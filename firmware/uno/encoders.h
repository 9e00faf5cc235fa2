/* Counts of two wheels from edges: quadrature (four counts a period) or one channel (two, signed by the duty). */
#pragma once
#include <stdint.h>

extern uint8_t encoders_fault; /* driven hard for half a second and not one count */

void encoders_edge(uint8_t pins); /* from the interrupt; bits 0 to 3: A left, A right, B left, B right */
void encoders_tick(void);         /* brings the counts into the telemetry */
