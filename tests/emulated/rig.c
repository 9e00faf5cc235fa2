/* An ATmega328P in libsimavr, stepped from Python. Built by rig.py; part of the tests alone, since simavr is GPL-3.

   What goes in (bytes, edges, voltages) waits in one queue and is delivered by a timer of the core at its exact
   cycle. What comes out (bytes, levels of the pins that hold the motors) is written down with its cycle. */
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { BYTE, PIN, ADC_MV };
enum { MCUSR = 0x54, DDRB = 0x24, DDRC = 0x27, TCCR1A = 0x80, TCCR1B = 0x81, ICR1 = 0x86, OCR1A = 0x88, SP = 0x5D };

typedef struct {
    uint64_t cycle, order;
    uint8_t what, place, value; /* PIN: place = port << 3 | bit, port A is 0 */
    uint16_t wide;
} event;

typedef struct {
    uint64_t cycle;
    float pwm[2];      /* share of time that the pin is high */
    uint8_t in[2][2];  /* direction pins */
    uint8_t standby, lamp, driven; /* driven: the motor pins are outputs */
    uint8_t pad;
} level;

typedef struct {
    uint64_t cycle;
    uint8_t byte;
} sent;

typedef struct {
    avr_t *avr;
    avr_irq_t *uart_in;
    event *queue;
    size_t waiting, room;
    uint64_t order;
    sent *out;
    size_t outs, out_room;
    level *levels;
    size_t n_levels, level_room;
    uint64_t seen[3];
    uint64_t half, half_cycle, instructions;
    uint32_t resets;
    void (*reset)(avr_t *);
} rig;

static rig *only; /* the reset of a core has no argument of its own; one rig runs at a time in a thread */

static void quiet(avr_t *avr, const int level, const char *format, va_list ap) { (void)avr, (void)level, (void)format, (void)ap; }
static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

static int sooner(const event *a, const event *b) {
    return a->cycle < b->cycle || (a->cycle == b->cycle && a->order < b->order);
}

static void sink(rig *r, size_t at) {
    for (;;) {
        size_t child = 2 * at + 1;
        if (child >= r->waiting) return;
        if (child + 1 < r->waiting && sooner(&r->queue[child + 1], &r->queue[child])) child++;
        if (!sooner(&r->queue[child], &r->queue[at])) return;
        event e = r->queue[at];
        r->queue[at] = r->queue[child];
        r->queue[child] = e;
        at = child;
    }
}

static void deliver(rig *r, const event *e) {
    if (e->what == BYTE) avr_raise_irq(r->uart_in, e->value);
    else if (e->what == PIN)
        avr_raise_irq(avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ('A' + (e->place >> 3)), e->place & 7), e->value);
    else avr_raise_irq(avr_io_getirq(r->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + e->place), e->wide);
}

static avr_cycle_count_t due(avr_t *avr, avr_cycle_count_t when, void *param) {
    rig *r = param;
    (void)when;
    while (r->waiting && r->queue[0].cycle <= avr->cycle) {
        event e = r->queue[0];
        r->queue[0] = r->queue[--r->waiting];
        sink(r, 0);
        deliver(r, &e);
    }
    return r->waiting ? r->queue[0].cycle : 0;
}

static void watch(rig *r) {
    avr_cycle_timer_cancel(r->avr, due, r);
    if (!r->waiting) return;
    uint64_t now = r->avr->cycle, first = r->queue[0].cycle;
    avr_cycle_timer_register(r->avr, first > now ? first - now : 1, due, r);
}

static void put(rig *r, event e) {
    if (r->waiting == r->room) r->queue = realloc(r->queue, (r->room = r->room ? 2 * r->room : 256) * sizeof e);
    e.order = r->order++;
    size_t at = r->waiting++;
    r->queue[at] = e;
    while (at && sooner(&r->queue[at], &r->queue[(at - 1) / 2])) {
        event other = r->queue[(at - 1) / 2];
        r->queue[(at - 1) / 2] = r->queue[at];
        r->queue[at] = other;
        at = (at - 1) / 2;
    }
    if (at == 0) watch(r);
}

static void on_byte(avr_irq_t *irq, uint32_t value, void *param) {
    rig *r = param;
    (void)irq;
    if (r->outs == r->out_room) r->out = realloc(r->out, (r->out_room = r->out_room ? 2 * r->out_room : 4096) * sizeof *r->out);
    r->out[r->outs++] = (sent){r->avr->cycle, (uint8_t)value};
}

/* The pins from the registers: simavr 1.6 does not drive them in mode 8 of timer 1. */
static void look(rig *r) {
    const uint8_t *d = r->avr->data;
    uint64_t pins, timer, mode = d[TCCR1A] | d[TCCR1B] << 8;
    memcpy(&pins, d + DDRB, 8);
    memcpy(&timer, d + ICR1, 8);
    pins &= 0x000000FFFF00FFFF; /* DDRB, PORTB, DDRC, PORTC */
    timer &= 0x0000FFFFFFFFFFFF; /* ICR1, OCR1A, OCR1B */
    if (timer != r->half) r->half = timer, r->half_cycle = r->avr->cycle;
    if (pins == r->seen[0] && mode == r->seen[2]) {
        if (timer == r->seen[1]) return;
        /* the part takes both bytes of a register at once, simavr one after the other */
        if (r->avr->cycle < r->half_cycle + 4) return;
    }
    r->seen[0] = pins, r->seen[1] = timer, r->seen[2] = mode;
    uint8_t now[12] = {d[DDRB], d[DDRB + 1], d[DDRC], d[DDRC + 1], d[TCCR1A], d[TCCR1B]};
    memcpy(now + 6, d + ICR1, 6);
    level l = {.cycle = r->avr->cycle};
    uint16_t top = (uint16_t)(now[6] | now[7] << 8);
    uint8_t runs = (now[5] & 7) && ((now[4] & 3) | (now[5] >> 1 & 12)) == 8;
    for (int k = 0; k < 2; k++) {
        uint16_t compare = (uint16_t)(now[8 + 2 * k] | now[9 + 2 * k] << 8);
        uint8_t pin = (uint8_t)(2 << k), connected = (uint8_t)(now[4] >> (6 - 2 * k) & 3);
        if (!(now[0] & pin)) l.pwm[k] = 0;
        else if (connected == 2 && runs && top) l.pwm[k] = compare >= top ? 1.0f : (float)compare / top;
        else l.pwm[k] = connected ? -1.0f : (now[1] & pin) != 0; /* -1: a mode that the rig does not know */
        l.in[k][0] = (now[2] & now[3]) >> (1 + 2 * k) & 1;
        l.in[k][1] = (now[2] & now[3]) >> (2 + 2 * k) & 1;
    }
    l.standby = (now[2] & now[3]) >> 5 & 1;
    l.lamp = (now[0] & now[1]) >> 5 & 1;
    l.driven = (now[0] & 6) == 6;
    if (r->n_levels == r->level_room)
        r->levels = realloc(r->levels, (r->level_room = r->level_room ? 2 * r->level_room : 4096) * sizeof l);
    r->levels[r->n_levels++] = l;
}

static void on_reset(avr_t *avr) {
    if (only->reset) only->reset(avr);
    only->resets++;
    watch(only); /* a reset forgets the timers of the core */
}

rig *rig_new(const char *elf) {
    elf_firmware_t firmware = {0};
    avr_global_logger_set(quiet);
    if (elf && elf_read_firmware(elf, &firmware)) return NULL;
    rig *r = calloc(1, sizeof *r);
    avr_t *avr = r->avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = 5000;
    firmware.frequency = 16000000;
    if (elf) avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr->sleep = no_sleep;
    avr->log = 0;
    uint32_t flags;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    r->uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, r);
    avr_extint_set_strict_lvl_trig(avr, 0, 0);
    avr_extint_set_strict_lvl_trig(avr, 1, 0);
    r->reset = avr->reset;
    avr->reset = on_reset;
    memset(r->seen, 0xEE, sizeof r->seen);
    avr->data[MCUSR] = 1;
    return r;
}

void rig_free(rig *r) {
    avr_terminate(r->avr);
    free(r->queue), free(r->out), free(r->levels), free(r);
}

/* 0, or the state of a core that can go no further. A sleeping core overshoots, so the end is absolute. */
int rig_run_until(rig *r, uint64_t cycle) {
    only = r;
    while (r->avr->cycle < cycle) {
        int state = avr_run(r->avr);
        r->instructions++;
        look(r);
        if (state == cpu_Done || state == cpu_Crashed) return state;
    }
    return 0;
}

/* A reset as a pin or a supply makes it: the cause is told in MCUSR. */
void rig_reset(rig *r, uint8_t cause) {
    only = r;
    avr_reset(r->avr);
    r->avr->data[MCUSR] = cause;
    look(r);
}

void rig_put(rig *r, uint64_t cycle, uint8_t what, uint8_t place, uint16_t value) {
    put(r, (event){.cycle = cycle, .what = what, .place = place, .value = (uint8_t)value, .wide = value});
}

void rig_forget(rig *r) { r->waiting = 0; watch(r); }
uint64_t rig_cycle(rig *r) { return r->avr->cycle; }
uint64_t rig_instructions(rig *r) { return r->instructions; }
uint32_t rig_resets(rig *r) { return r->resets; }
uint32_t rig_pc(rig *r) { return r->avr->pc; }
void rig_jump(rig *r, uint32_t pc) { r->avr->pc = pc, r->avr->state = cpu_Running; } /* awake */
void rig_interrupts_off(rig *r) { r->avr->sreg[7] = 0; r->avr->interrupt_state = 0; }
void rig_start_at(rig *r, uint32_t pc) { r->avr->pc = r->avr->reset_pc = pc; r->avr->codeend = r->avr->flashend; }
void rig_flash(rig *r, uint32_t at, const uint8_t *bytes, size_t n) { memcpy(r->avr->flash + at, bytes, n); }
void rig_flash_read(rig *r, uint32_t at, uint8_t *bytes, size_t n) { memcpy(bytes, r->avr->flash + at, n); }
void rig_ram(rig *r, uint32_t at, const uint8_t *bytes, size_t n) { memcpy(r->avr->data + at, bytes, n); }
void rig_ram_read(rig *r, uint32_t at, uint8_t *bytes, size_t n) { memcpy(bytes, r->avr->data + at, n); }

void rig_eeprom_read(rig *r, uint32_t at, uint8_t *bytes, size_t n) {
    avr_eeprom_desc_t d = {.ee = bytes, .offset = (uint16_t)at, .size = (uint32_t)n};
    avr_ioctl(r->avr, AVR_IOCTL_EEPROM_GET, &d);
}

void rig_eeprom(rig *r, uint32_t at, const uint8_t *bytes, size_t n) {
    avr_eeprom_desc_t d = {.ee = (uint8_t *)bytes, .offset = (uint16_t)at, .size = (uint32_t)n};
    avr_ioctl(r->avr, AVR_IOCTL_EEPROM_SET, &d);
}

size_t rig_outs(rig *r) { return r->outs; }
const sent *rig_out(rig *r) { return r->out; }
void rig_clear_out(rig *r) { r->outs = 0; }
size_t rig_n_levels(rig *r) { return r->n_levels; }
const level *rig_levels(rig *r) { return r->levels; }
void rig_clear_levels(rig *r) { if (r->n_levels > 1) r->levels[0] = r->levels[r->n_levels - 1], r->n_levels = 1; }
