/* Execute the frames: check who may move the motors, send the answers, refuse and count the other frames. */
#pragma once
#include <stdint.h>

#include "frames.h"

void protocol_begin(void);             /* sends INFO once */
void protocol_take(uint8_t byte);      /* processes a received byte */
void protocol_tick(void);              /* sends telemetry, and the answer to SETTINGS when they are stored */
