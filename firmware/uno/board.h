/* What the program asks of the board: board.c answers on an ATmega328P at 16 MHz, the tests answer on a host.

   Pins (Arduino names)    channel 0     channel 1
     PWM / enable          D9            D10        Timer1, mode 8: exact 0 % and 100 %
     direction 1, 2        A1, A2        A3, A4
     encoder A, B          D2, D4        D3, D7     pulled up
   standby of a TB6612 A5; battery through a divider A0; lap mark D5, pulled up; lamp D13 (armed).

   Give D9, D10 and A5 10 kOhm to ground: from a reset until board_begin() every pin floats. */
#pragma once
#include <stdint.h>

#define LEFT 0
#define RIGHT 1

void board_begin(void); /* motors off, clocks, pins */
void board_live(void);  /* interrupts and watchdog on */

/* Motors. duty in per mille, its sign is the direction of the pins; 0 takes the pin from the timer at once,
   whatever the PWM frequency. */
void board_bridge(uint8_t awake); /* standby pin and lamp */
void board_drive(uint8_t channel, int16_t duty);
void board_rest(uint8_t channel, uint8_t driver, uint8_t brake);
void board_pwm_hz(uint16_t hz); /* both channels off until driven again */

/* Time since the boot; a tick is 1 ms. board_tick is 1 once for each, and is the sign of life that the watchdog
   waits for; board_sleep returns at the next interrupt. */
uint32_t board_micros(void);
uint8_t board_tick(void);
void board_sleep(void);

/* Volts at A0, 1023 is 5 V; starts the next conversion. */
uint16_t board_battery(void);

/* The mark pin, 1 is high. */
uint8_t board_mark(void);

/* Bytes. board_take is 0 when there is none; board_send takes all of them or none. */
uint8_t board_take(uint8_t *byte);
void board_send(const uint8_t *bytes, uint8_t length);

/* EEPROM, one byte at a time; a write waits only when the last one is not over. */
uint8_t board_eeprom_ready(void);
uint8_t board_eeprom_read(uint16_t place);
void board_eeprom_write(uint16_t place, uint8_t value);

/* Why it started, bits RESET_CAUSE_*; bytes of RAM that the stack never touched, known 0.2 s after the boot if
   asked each tick. */
uint8_t board_reset_cause(void);
uint16_t board_free_ram(void);

/* Keeps interrupts out of what lies between. */
uint8_t board_lock(void);
void board_unlock(uint8_t before);
