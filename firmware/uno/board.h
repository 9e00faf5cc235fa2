/* The functions of the board: board.c has those of an ATmega328P at 16 MHz, the tests have those of a host.

   Pins (Arduino names)    channel 0     channel 1
     PWM / enable          D9            D10        Timer1, mode 8: exact 0 % and 100 %
     direction 1, 2        A1, A2        A3, A4
     encoder A, B          D2, D4        D3, D7     pulled up
   standby of a TB6612 A5; battery through a divider A0; lap mark D5, pulled up; lamp D13 (armed).

   Connect D9, D10 and A5 to ground by 10 kOhm: all pins float from a reset until board_begin(). */
#pragma once
#include <stdint.h>

#define LEFT 0
#define RIGHT 1

void board_begin(void); /* motors off, clocks, pins */
void board_live(void);  /* interrupts and watchdog on */

/* Motors. The duty is in per mille, and its sign is the direction of the pins. With 0 the pin leaves the timer at
   once, at any PWM frequency. */
void board_bridge(uint8_t awake); /* standby pin and lamp */
void board_drive(uint8_t channel, int16_t duty);
void board_rest(uint8_t channel, uint8_t driver, uint8_t brake);
void board_pwm_hz(uint16_t hz); /* both channels are off until the next board_drive */

/* Time since the boot; a tick is 1 ms. board_tick returns 1 once per tick, and resets the watchdog; board_sleep
   returns at the next interrupt. */
uint32_t board_micros(void);
uint8_t board_tick(void);
void board_sleep(void);

/* Return the voltage at A0, where 1023 is 5 V; start the next conversion. */
uint16_t board_battery(void);

/* Return the level of the mark pin; 1 is high. */
uint8_t board_mark(void);

/* Bytes. board_take returns 0 without a byte; board_send sends all of its bytes or none. */
uint8_t board_take(uint8_t *byte);
void board_send(const uint8_t *bytes, uint8_t length);

/* EEPROM, byte by byte; a write waits only until the previous one is finished. */
uint8_t board_eeprom_ready(void);
uint8_t board_eeprom_read(uint16_t place);
void board_eeprom_write(uint16_t place, uint8_t value);

/* Return the cause of the start, bits RESET_CAUSE_*, and the bytes of RAM that the stack never used. The latter is
   valid 0.2 s after the boot if it is called in each tick. */
uint8_t board_reset_cause(void);
uint16_t board_free_ram(void);

/* Block interrupts between the two calls. */
uint8_t board_lock(void);
void board_unlock(uint8_t before);
