/* Store the settings of this vehicle in EEPROM, with a version and a CRC-16, and the count of its boots. */
#pragma once
#include <stdint.h>

#include "frames.h"

extern settings_t settings;
extern uint8_t settings_factory; /* 1: EEPROM contains no settings, or damaged ones */

void settings_begin(void);                     /* reads both, and counts this boot */
uint8_t settings_in_range(const settings_t *s);
void settings_take(const settings_t *s);       /* in force now; the next ticks store them */
uint8_t settings_tick(void);                   /* 1: the last byte is stored and verified */
