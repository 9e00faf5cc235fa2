#include "board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "encoders.h"
#include "frames.h"
#include "mark.h"
#include "telemetry.h"

#if F_CPU != 16000000UL
#error "ticks and baud rate are those of 16 MHz"
#endif

#define TICK_COUNTS 250 /* of 4 us */
#define STALLED_MS 100  /* time without a tick before a reset: the program hung */
#define PAINT 0xC5
#define ALIVE 0xA55A
#define IN_SIZE 64
#define OUT_SIZE 128

#define PWM(channel) ((channel) ? _BV(PB2) : _BV(PB1))
#define CONNECT(channel) ((channel) ? _BV(COM1B1) : _BV(COM1A1))
#define COMPARE(channel) (&OCR1A)[channel]
#define INPUT1(channel) ((channel) ? _BV(PC3) : _BV(PC1))
#define INPUT2(channel) ((channel) ? _BV(PC4) : _BV(PC2))
#define STANDBY _BV(PC5)
#define LAMP _BV(PB5)
#define MARK _BV(PD5)

static volatile uint8_t in_bytes[IN_SIZE], out_bytes[OUT_SIZE];
static volatile uint8_t in_head, in_tail, out_head, out_tail;
static volatile uint8_t ticks;
static volatile uint32_t now_ms;
static uint16_t top;
static uint8_t cause;

/* These values survive a reset without a loss of power. */
static uint16_t alive __attribute__((section(".noinit")));
static volatile uint8_t stalled_ms __attribute__((section(".noinit")));
static uint8_t mcusr __attribute__((section(".noinit")));

extern uint8_t __heap_start;

/* Run before anything else: a watchdog that fired stays on with its shortest time. Then paint the RAM of the stack. */
void first(void) __attribute__((naked, used, section(".init3")));
void first(void) {
    mcusr = MCUSR;
    MCUSR = 0;
    wdt_disable();
    for (uint8_t *p = &__heap_start; p <= (uint8_t *)RAMEND; p++) *p = PAINT;
}

static void begin_pins(void) {
    PORTB = 0;
    PORTC = 0;
    DDRB = PWM(LEFT) | PWM(RIGHT) | LAMP;
    DDRC = INPUT1(LEFT) | INPUT2(LEFT) | INPUT1(RIGHT) | INPUT2(RIGHT) | STANDBY;
    PORTD = _BV(PD0) | _BV(PD2) | _BV(PD3) | _BV(PD4) | _BV(PD7) | MARK;
    PCMSK2 = _BV(PD2) | _BV(PD3) | _BV(PD4) | _BV(PD7) | MARK;
    PCICR = _BV(PCIE2);
}

void board_begin(void) {
    begin_pins();
    uint8_t warm = alive == ALIVE && !(mcusr & RESET_CAUSE_POWER);
    cause = mcusr & 0x0F;
    if (warm) cause |= RESET_CAUSE_WARM | (stalled_ms >= STALLED_MS ? RESET_CAUSE_HUNG : 0);
    alive = ALIVE;
    stalled_ms = 0;
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = TICK_COUNTS - 1;
    TIMSK0 = _BV(OCIE0A);
    UCSR0A = _BV(U2X0);
    UBRR0 = (F_CPU / 4 / BAUD_RATE - 1) / 2;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    ADMUX = _BV(REFS0);
    DIDR0 = _BV(ADC0D);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

/* A left, A right, B left, B right from D2, D3, D4, D7. */
static uint8_t encoder_pins(uint8_t pins) { return (pins >> 2 & 7) | (pins >> 4 & 8); }

void board_live(void) {
    encoders_edge(encoder_pins(PIND)); /* the present level of the pins is not an edge */
    wdt_enable(WDTO_120MS);
    sei();
}

ISR(PCINT2_vect) {
    static uint8_t before = MARK;
    uint8_t pins = PIND;
    if ((pins ^ before) & MARK) mark_edge((pins & MARK) != 0);
    before = pins;
    encoders_edge(encoder_pins(pins));
}

ISR(TIMER0_COMPA_vect) {
    now_ms++;
    ticks++;
    if (stalled_ms != 255) stalled_ms++;
}

uint8_t board_tick(void) {
    static uint8_t taken;
    if (taken == ticks) return 0;
    taken++;
    stalled_ms = 0;
    wdt_reset();
    return 1;
}

void board_sleep(void) {
    cli();
    if (!stalled_ms && in_head == in_tail) {
        sleep_enable();
        sei();
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

uint32_t board_micros(void) {
    uint8_t was = board_lock();
    uint32_t ms = now_ms;
    uint8_t counts = TCNT0;
    if (TIFR0 & _BV(OCF0A)) { /* the tick is due, and its interrupt waits */
        ms++;
        counts = TCNT0;
    }
    board_unlock(was);
    return ms * 1000 + counts * 4U;
}

uint8_t board_lock(void) {
    uint8_t was = SREG;
    cli();
    return was;
}

void board_unlock(uint8_t was) { SREG = was; }

ISR(USART_RX_vect) {
    uint8_t lost = UCSR0A & _BV(DOR0), byte = UDR0, next = (in_head + 1) & (IN_SIZE - 1);
    if (lost) state.overruns++;
    if (next == in_tail) {
        state.overruns++;
        return;
    }
    in_bytes[in_head] = byte;
    in_head = next;
}

ISR(USART_UDRE_vect) {
    if (out_head == out_tail) {
        UCSR0B &= ~_BV(UDRIE0);
        return;
    }
    UDR0 = out_bytes[out_tail];
    out_tail = (out_tail + 1) & (OUT_SIZE - 1);
}

uint8_t board_take(uint8_t *byte) {
    if (in_head == in_tail) return 0;
    *byte = in_bytes[in_tail];
    in_tail = (in_tail + 1) & (IN_SIZE - 1);
    return 1;
}

void board_send(const uint8_t *bytes, uint8_t length) {
    uint8_t room = (out_tail - out_head - 1) & (OUT_SIZE - 1), head = out_head;
    if (length > room) return;
    while (length--) {
        out_bytes[head] = *bytes++;
        head = (head + 1) & (OUT_SIZE - 1);
    }
    out_head = head;
    uint8_t was = board_lock();
    UCSR0B |= _BV(UDRIE0);
    board_unlock(was);
}

void board_pwm_hz(uint16_t hz) {
    uint8_t slow = hz < 123; /* the counter has 16 bits */
    top = (slow ? F_CPU / 16 : F_CPU / 2) / hz;
    TCCR1B = 0; /* stopped: a counter above a new top would run on to the end of its bits */
    TCCR1A = 0;
    ICR1 = top;
    OCR1A = OCR1B = 0;
    TCNT1 = 0;
    TCCR1B = _BV(WGM13) | (slow ? _BV(CS11) : _BV(CS10));
}

void board_drive(uint8_t channel, int16_t duty) {
    uint8_t on = INPUT1(channel), off = INPUT2(channel);
    if (duty < 0) {
        duty = -duty;
        on = off;
        off = INPUT1(channel);
    }
    PORTB &= ~PWM(channel);
    PORTC = (PORTC & ~off) | on;
    COMPARE(channel) = (uint16_t)((uint32_t)top * (uint16_t)duty / 1000);
    TCCR1A |= CONNECT(channel);
}

/* Coast or brake by the three truth tables: a TB6612 shorts the motor with both inputs high, the others
   with both inputs low and the enable pin high. */
void board_rest(uint8_t channel, uint8_t driver, uint8_t brake) {
    uint8_t inputs = INPUT1(channel) | INPUT2(channel), pwm = PWM(channel), low = driver != DRIVER_TB6612;
    TCCR1A &= ~CONNECT(channel);
    COMPARE(channel) = 0;
    if (brake && low) {
        PORTC &= ~inputs;
        PORTB |= pwm;
        return;
    }
    PORTB &= ~pwm;
    if (brake) PORTC |= inputs;
    else PORTC &= ~inputs;
}

void board_bridge(uint8_t awake) {
    if (awake) PORTC |= STANDBY, PORTB |= LAMP;
    else PORTC &= ~STANDBY, PORTB &= ~LAMP;
}

uint16_t board_battery(void) {
    uint16_t raw = ADC;
    ADCSRA |= _BV(ADSC);
    return raw;
}

uint8_t board_mark(void) { return (PIND & MARK) != 0; }

uint8_t board_eeprom_ready(void) { return eeprom_is_ready(); }

uint8_t board_eeprom_read(uint16_t place) { return eeprom_read_byte((const uint8_t *)place); }

void board_eeprom_write(uint16_t place, uint8_t value) { eeprom_update_byte((uint8_t *)place, value); }

uint8_t board_reset_cause(void) { return cause; }

/* Search a few bytes per tick: the whole search would delay the motors by a millisecond. */
uint16_t board_free_ram(void) {
    static uint8_t *at = &__heap_start;
    static uint16_t free_bytes;
    for (uint8_t k = 0; k < 8; k++) {
        if (*at++ == PAINT) continue;
        free_bytes = (uint16_t)(at - 1 - &__heap_start);
        at = &__heap_start;
    }
    return free_bytes;
}
