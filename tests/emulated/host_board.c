/* The firmware's protocol.c, motors.c, frame.c, settings.c, encoders.c and mark.c on a host, armed and at rest, under
   damaged frames: host_firmware SEED FRAMES. This file stands for board.c. Each frame was right before it was
   damaged: the nonce of this boot, a newer sequence, numbers in range. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "encoders.h"
#include "frame.h"
#include "mark.h"
#include "motors.h"
#include "protocol.h"
#include "settings.h"
#include "telemetry.h"

static uint32_t clock_us;
static uint64_t driven; /* times that a motor was driven */
static uint8_t eeprom[1024];
static uint32_t eeprom_writes;

void board_bridge(uint8_t awake) { (void)awake; }
void board_drive(uint8_t channel, int16_t duty) { (void)channel, driven += duty != 0; }
void board_rest(uint8_t channel, uint8_t driver, uint8_t brake) { (void)channel, (void)driver, (void)brake; }
void board_pwm_hz(uint16_t hz) { (void)hz; }
uint32_t board_micros(void) { return clock_us; }
uint16_t board_battery(void) { return 505; }
uint8_t board_mark(void) { return 0; }
void board_send(const uint8_t *bytes, uint8_t length) { (void)bytes, (void)length; }
uint8_t board_eeprom_ready(void) { return 1; }
uint8_t board_eeprom_read(uint16_t place) { return eeprom[place]; }
void board_eeprom_write(uint16_t place, uint8_t value) { eeprom[place] = value, eeprom_writes++; }
uint8_t board_reset_cause(void) { return RESET_CAUSE_POWER; }
uint16_t board_free_ram(void) { return 0; }
uint8_t board_lock(void) { return 0; }
void board_unlock(uint8_t before) { (void)before; }

static uint64_t random_state;
static uint32_t any(uint32_t below) { /* xorshift64*, Vigna 2016 */
    random_state ^= random_state >> 12, random_state ^= random_state << 25, random_state ^= random_state >> 27;
    return (uint32_t)((random_state * 0x2545F4914F6CDD1DULL) >> 32) % below;
}

static void tick(void) {
    clock_us += 1000;
    motors_tick();
    encoders_tick();
    mark_tick();
    protocol_tick();
}

static uint16_t seal(const uint8_t *bytes, size_t n) {
    uint16_t crc = 0;
    while (n--) {
        crc ^= (uint16_t)(*bytes++ << 8);
        for (int bit = 0; bit < 8; bit++) crc = (uint16_t)(crc << 1) ^ (crc & 0x8000 ? SEAL_POLYNOMIAL : 0);
    }
    return crc;
}

/* A frame as a host would send it, without damage; its length. */
static size_t frame(uint8_t *wire, uint8_t kind, uint8_t seq, const void *payload, size_t n) {
    uint8_t body[64] = {kind, seq};
    memcpy(body + 2, payload, n);
    n += 2;
    if (SEALED_KINDS >> kind & 1) {
        uint16_t s = seal(body, n);
        body[n++] = (uint8_t)(s >> 8), body[n++] = (uint8_t)s;
    }
    uint16_t crc = frame_crc(body, (uint8_t)n);
    body[n++] = (uint8_t)(crc >> 8), body[n++] = (uint8_t)crc;
    size_t mark = 1, at = 2;
    wire[0] = 0;
    for (size_t k = 0; k < n; k++, at++) {
        wire[at] = body[k];
        if (!body[k]) wire[mark] = (uint8_t)(at - mark), mark = at;
    }
    wire[mark] = (uint8_t)(at - mark);
    wire[at++] = 0;
    return at;
}

/* Full ahead, with everything right: what must not get through once it is damaged. */
static size_t command(uint8_t *wire, uint8_t seq) {
    drive_t d = {state.nonce, (int16_t)(200 + any(801)), (int16_t)(200 + any(801)), DRIVE_FLAG_ARM, 0};
    return frame(wire, KIND_DRIVE, seq, &d, sizeof d);
}

static size_t damage(uint8_t *wire, size_t n) {
    uint8_t clean[96];
    size_t was = n;
    memcpy(clean, wire, n);
    do {
        memcpy(wire, clean, was);
        n = was;
        switch (any(6)) {
        case 0: /* bits */
            for (uint32_t k = 1 + any(12); k; k--) wire[1 + any((uint32_t)n - 2)] ^= (uint8_t)(1 << any(8));
            break;
        case 1: /* bytes */
            for (uint32_t k = 1 + any(8); k; k--) wire[1 + any((uint32_t)n - 2)] = (uint8_t)any(256);
            break;
        case 2: { /* a burst */
            uint32_t start = 1 + any((uint32_t)n - 2), end = start + 1 + any(6);
            for (uint32_t k = start; k < end && k < n - 1; k++) wire[k] = (uint8_t)any(256);
            break;
        }
        case 3: { /* a byte lost */
            uint32_t at = 1 + any((uint32_t)n - 2);
            memmove(wire + at, wire + at + 1, n - at - 1), n--;
            break;
        }
        case 4: { /* a byte too many */
            uint32_t at = 1 + any((uint32_t)n - 1);
            memmove(wire + at + 1, wire + at, n - at), n++;
            wire[at] = (uint8_t)(1 + any(255));
            break;
        }
        case 5: { /* a block lost between two frames: the head of one, the tail of the other */
            uint8_t other[96];
            size_t m = command(other, (uint8_t)any(256)), cut = 1 + any((uint32_t)(n < m ? n : m) - 2);
            memcpy(wire + cut, other + cut, m - cut), n = m;
            if (!memcmp(wire, other, n)) memcpy(wire, clean, n = was); /* the other one, whole: no damage */
            break;
        }
        }
    } while (n == was && !memcmp(wire, clean, n));
    return n;
}

static void feed(const uint8_t *wire, size_t n) {
    for (size_t k = 0; k < n; k++) protocol_take(wire[k]);
}

/* Armed and told to stand: the state in which a wrong command does most. */
static uint8_t stand(uint8_t seq) {
    uint8_t wire[96];
    drive_t d = {state.nonce, 0, 0, DRIVE_FLAG_CLEAR_STOP, 0};
    feed(wire, frame(wire, KIND_DRIVE, ++seq, &d, sizeof d));
    d.flags = DRIVE_FLAG_ARM;
    feed(wire, frame(wire, KIND_DRIVE, ++seq, &d, sizeof d));
    if (!motors_armed || motors_dead_man || state.drive_seq != seq) abort();
    return seq;
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    random_state = strtoull(argv[1], 0, 10) * 0x9E3779B97F4A7C15ULL | 1;
    uint32_t frames = (uint32_t)strtoul(argv[2], 0, 10), changed = 0;
    memset(eeprom, 0xFF, sizeof eeprom);
    settings_begin();
    motors_begin();
    protocol_begin();
    uint32_t writes = eeprom_writes;
    config_t config = info.config;
    settings_t kept = settings;
    uint8_t seq = stand(0);
    for (uint32_t k = 0; k < frames; k++) {
        uint8_t wire[96];
        uint32_t which = any(8);
        size_t n;
        if (which == 0) {
            config_t c = {.dead_man_ms = 1000, .telemetry_ms = 50, .slew_permille_per_ms = 1000, .pwm_hz = 50};
            n = frame(wire, KIND_CONFIG, seq, &c, sizeof c);
        } else if (which == 1) {
            settings_t s = kept;
            s.wiring = WIRING_LEFT_MOTOR_REVERSED;
            n = frame(wire, KIND_SETTINGS, seq, &s, sizeof s);
        } else {
            n = command(wire, (uint8_t)(seq + 1 + any(100)));
        }
        feed(wire, damage(wire, n));
        tick();
        changed += memcmp(&config, &info.config, sizeof config) != 0 || memcmp(&kept, &settings, sizeof kept) != 0;
        if (k % 100 == 99) seq = stand(seq);
    }
    printf("{\"frames\": %u, \"driven\": %llu, \"changed\": %u, \"eeprom_writes\": %u, \"bad_crc\": %u, "
           "\"bad_shape\": %u, \"refused\": %u}\n", frames, (unsigned long long)driven, changed,
           eeprom_writes - writes, info.bad_crc, info.bad_shape,
           info.wrong_nonce + info.old_sequence + info.out_of_range + info.not_armed);
    uint8_t wire[96]; /* and what is right is still obeyed */
    feed(wire, command(wire, ++seq));
    for (int k = 0; k < 100; k++) tick();
    return motors_armed && driven ? 0 : 3;
}
