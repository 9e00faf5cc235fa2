/* Compute the duty of two wheels from a command, once per millisecond, and stop the motors for each reason. */
#pragma once
#include <stdint.h>

#include "frames.h"

extern uint8_t motors_armed, motors_dead_man, motors_stopped, motors_battery_low;
extern uint8_t motors_saturated; /* a bit for each wheel whose command exceeds full duty */

void motors_begin(void);
void motors_set(const drive_t *drive); /* the command must be armed and in range */
void motors_arm(void);
void motors_disarm(void);
void motors_stop(void);
void motors_configure(const config_t *c);
uint16_t motors_most_pwm_hz(uint8_t driver);
void motors_tick(void);
