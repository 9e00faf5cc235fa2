#include "protocol.h"

#include <string.h>

#include "board.h"
#include "encoders.h"
#include "frame.h"
#include "mark.h"
#include "motors.h"
#include "settings.h"
#include "telemetry.h"

state_t state;
info_t info = {
    .protocol = PROTOCOL,
    .version_major = VERSION_MAJOR,
    .version_minor = VERSION_MINOR,
    .version_patch = VERSION_PATCH,
};
#define SEAL 2 /* bytes at the end of a payload that may move the motors */
static uint8_t has_drive; /* 1: a DRIVE was executed in this session */

static void send_info(void) {
    info.driver = settings.driver;
    info.encoders = settings.encoders;
    frame_send(KIND_INFO, &info, sizeof info);
}

static void send_settings(void) { frame_send(KIND_SETTINGS_NOW, &settings, sizeof settings); }

static uint8_t flags(void) {
    return (motors_armed ? STATE_FLAG_ARMED : 0) | (motors_dead_man ? STATE_FLAG_DEAD_MAN : 0) |
           (motors_stopped ? STATE_FLAG_STOPPED : 0) | (motors_battery_low ? STATE_FLAG_BATTERY_LOW : 0) |
           (encoders_fault ? STATE_FLAG_ENCODER_FAULT : 0) | (motors_saturated ? STATE_FLAG_SATURATED : 0) |
           (settings_factory ? STATE_FLAG_FACTORY : 0) | (mark_on ? STATE_FLAG_ON_MARK : 0);
}

static void send_state(void) {
    state.t_us = board_micros();
    state.flags = flags();
    state.bad_frames = (uint8_t)(info.bad_crc + info.bad_shape);
    state.ignored_frames = (uint8_t)(info.wrong_nonce + info.old_sequence + info.out_of_range + info.not_armed);
    frame_send(KIND_STATE, &state, sizeof state);
}

/* One comparison tests both limits, here and below: a value below the least wraps to one far above the most. */
static uint8_t duty_in_range(int16_t duty) {
    return (uint16_t)(duty - DRIVE_LEFT_PERMILLE_LEAST) <= DRIVE_LEFT_PERMILLE_MOST - DRIVE_LEFT_PERMILLE_LEAST;
}

static uint8_t drive_in_range(const drive_t *d) {
    uint8_t zero = !d->left_permille && !d->right_permille;
    if (d->flags > DRIVE_FLAGS_MOST) return 0;
    if (d->flags & DRIVE_FLAG_CLEAR_STOP && (!zero || d->flags != DRIVE_FLAG_CLEAR_STOP)) return 0;
    if (d->flags & DRIVE_FLAG_BRAKE && !zero) return 0;
    return duty_in_range(d->left_permille) && duty_in_range(d->right_permille);
}

static uint16_t *drive(uint8_t seq, const drive_t *d) {
    if (d->nonce != info.nonce) return &info.wrong_nonce;
    if (!drive_in_range(d)) return &info.out_of_range;
    if (has_drive && (uint8_t)(seq - state.drive_seq - 1) >= 127) return &info.old_sequence;
    if (d->flags & DRIVE_FLAG_ARM) {
        if (motors_stopped || motors_battery_low) return &info.not_armed;
        if (!motors_armed) {
            if (d->left_permille || d->right_permille) return &info.not_armed;
            motors_arm();
        }
        motors_set(d);
    } else {
        motors_disarm();
        if (d->flags & DRIVE_FLAG_CLEAR_STOP) motors_stopped = 0;
    }
    state.drive_seq = seq;
    has_drive = 1;
    return 0;
}

#define OUT(value, name) ((uint16_t)((value) - CONFIG_##name##_LEAST) > CONFIG_##name##_MOST - CONFIG_##name##_LEAST)

static uint16_t *configure(const config_t *c) {
    if (OUT(c->dead_man_ms, DEAD_MAN_MS) || OUT(c->telemetry_ms, TELEMETRY_MS) ||
        OUT(c->slew_permille_per_ms, SLEW_PERMILLE_PER_MS) || OUT(c->pwm_hz, PWM_HZ) ||
        c->pwm_hz > motors_most_pwm_hz(settings.driver) || c->least_battery_mv > CONFIG_LEAST_BATTERY_MV_MOST)
        return &info.out_of_range;
    motors_configure(c);
    return 0;
}

static uint16_t *settle(const settings_t *s) {
    if (!settings_in_range(s)) return &info.out_of_range;
    if (motors_armed) return &info.not_armed;
    settings_take(s);
    motors_configure(&info.config); /* another driver might not follow this PWM */
    return 0;
}

/* Return the counter to raise, or 0 if the frame was executed. */
static uint16_t *execute(const frame_t *f) {
    static const uint8_t lengths[] = {DRIVE_LENGTH + SEAL, CONFIG_LENGTH + SEAL, PING_LENGTH, STOP_LENGTH,
                                      ASK_INFO_LENGTH, SETTINGS_LENGTH + SEAL, ASK_SETTINGS_LENGTH};
    if (f->kind < KIND_DRIVE || f->kind > KIND_ASK_SETTINGS || f->length != lengths[f->kind - KIND_DRIVE])
        return &info.bad_shape;
    if ((SEALED_KINDS >> f->kind & 1) && !frame_sealed(f)) return &info.bad_crc;
    uint16_t *wrong;
    switch (f->kind) {
    case KIND_DRIVE: return drive(f->seq, (const drive_t *)f->payload);
    case KIND_SETTINGS: return settle((const settings_t *)f->payload);
    case KIND_STOP: motors_stop(); break;
    case KIND_PING: {
        pong_t pong = {.t_us = board_micros()};
        memcpy(&pong.token, f->payload, sizeof pong.token);
        frame_send(KIND_PONG, &pong, sizeof pong);
        break;
    }
    case KIND_CONFIG:
        wrong = configure((const config_t *)f->payload);
        if (wrong) ++*wrong; /* before INFO is sent */
        /* fall through */
    case KIND_ASK_INFO: send_info(); break;
    case KIND_ASK_SETTINGS: send_settings(); break;
    }
    return 0;
}

void protocol_begin(void) {
    info.nonce = state.nonce = (uint8_t)info.boots;
    info.reset_cause = board_reset_cause();
    send_info();
}

void protocol_take(uint8_t byte) {
    const frame_t *frame = frame_take(byte);
    uint16_t *wrong = frame ? execute(frame) : 0;
    if (wrong) ++*wrong;
}

void protocol_tick(void) {
    static uint8_t wait;
    info.least_free_ram = board_free_ram();
    if (settings_tick()) send_settings();
    if (wait--) return;
    wait = info.config.telemetry_ms - 1;
    send_state();
}
