/* What each frame means: who may move the motors, what is answered, what is refused and counted. */
#pragma once
#include <stdint.h>

#include "frames.h"

void protocol_begin(void);             /* tells INFO once */
void protocol_take(uint8_t byte);      /* a byte that arrived */
void protocol_tick(void);              /* telemetry, and the answer to SETTINGS once stored */
