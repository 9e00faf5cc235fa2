#include "settings.h"

#include "board.h"
#include "frame.h"
#include "telemetry.h"

#define LAYOUT 1
#define AT_BOOTS 0 /* two cells of 2 bytes, used in turn: if the power fails during one write, the other is valid */
#define AT_SETTINGS 8

typedef struct __attribute__((packed)) {
    uint8_t layout;
    settings_t settings;
    uint16_t crc;
} stored_t;

settings_t settings;
uint8_t settings_factory;
static stored_t stored;
static uint8_t next = sizeof(stored_t) + 1; /* the byte to store; size: verify the last byte; size + 1: finished */

static uint16_t boots_cell(uint8_t place) {
    return board_eeprom_read(place) | (uint16_t)board_eeprom_read(place + 1) << 8;
}

static void count_boot(void) {
    uint16_t a = boots_cell(AT_BOOTS), b = boots_cell(AT_BOOTS + 2);
    uint16_t last = a == (uint16_t)(b + 1) ? a : b == (uint16_t)(a + 1) ? b : a > b ? a : b;
    info.boots = last + 1;
    uint8_t place = info.boots & 1 ? AT_BOOTS + 2 : AT_BOOTS;
    board_eeprom_write(place, (uint8_t)info.boots);
    board_eeprom_write(place + 1, (uint8_t)(info.boots >> 8));
}

void settings_begin(void) {
    static const settings_t factory = SETTINGS_DEFAULT;
    count_boot();
    uint8_t *bytes = (uint8_t *)&stored;
    for (uint8_t k = 0; k < sizeof stored; k++) bytes[k] = board_eeprom_read(AT_SETTINGS + k);
    settings_factory = stored.layout != LAYOUT || stored.crc != frame_crc(bytes, sizeof stored - 2) ||
                       !settings_in_range(&stored.settings);
    settings = settings_factory ? factory : stored.settings;
}

/* A value below the least wraps to one far above the most. */
#define IN(value, name) ((uint16_t)((value) - name##_LEAST) <= name##_MOST - name##_LEAST)

uint8_t settings_in_range(const settings_t *s) {
    for (uint8_t k = 0; k < 4; k++) {
        const wheel_curve_t *wheel = &s->curves[k];
        if (wheel->dead_zone_permille > WHEEL_CURVE_DEAD_ZONE_PERMILLE_MOST ||
            wheel->kick_permille > WHEEL_CURVE_KICK_PERMILLE_MOST ||
            !IN(wheel->slope_permille, WHEEL_CURVE_SLOPE_PERMILLE))
            return 0;
    }
    return s->wiring <= SETTINGS_WIRING_MOST && IN(s->driver, SETTINGS_DRIVER) && s->encoders <= SETTINGS_ENCODERS_MOST &&
           s->kick_ms <= SETTINGS_KICK_MS_MOST && s->dither_permille <= SETTINGS_DITHER_PERMILLE_MOST &&
           IN(s->dither_ms, SETTINGS_DITHER_MS) && IN(s->battery_permille, SETTINGS_BATTERY_PERMILLE);
}

void settings_take(const settings_t *s) {
    settings = stored.settings = *s;
    stored.layout = LAYOUT;
    stored.crc = frame_crc((const uint8_t *)&stored, sizeof stored - 2);
    settings_factory = 1; /* until the last byte is stored */
    next = 0;
}

uint8_t settings_tick(void) {
    const uint8_t *bytes = (const uint8_t *)&stored;
    if (next > sizeof stored || !board_eeprom_ready()) return 0;
    if (next && board_eeprom_read(AT_SETTINGS + next - 1) != bytes[next - 1]) {
        next--; /* not stored: try again, without an answer until then */
    } else if (next == sizeof stored) {
        next++;
        settings_factory = 0;
        return 1;
    }
    board_eeprom_write(AT_SETTINGS + next, bytes[next]);
    next++;
    return 0;
}
