/* Made from src/baqueano/robot/uno/frames.py: change that, then `make firmware`. */
#pragma once
#include <stdint.h>

#define PROTOCOL 1
#define BAUD_RATE 115200UL
#define MAX_PAYLOAD 40
#define NO_AGE 65535
#define SEAL_POLYNOMIAL 0x8bb7
#define SEALED_KINDS 0x46 /* a bit for each */
#define VERSION_MAJOR 1
#define VERSION_MINOR 0
#define VERSION_PATCH 0
#define KIND_DRIVE 0x01
#define KIND_CONFIG 0x02
#define KIND_PING 0x03
#define KIND_STOP 0x04
#define KIND_ASK_INFO 0x05
#define KIND_SETTINGS 0x06
#define KIND_ASK_SETTINGS 0x07
#define KIND_STATE 0x81
#define KIND_PONG 0x83
#define KIND_INFO 0x85
#define KIND_SETTINGS_NOW 0x86

#define DRIVE_FLAG_ARM 1
#define DRIVE_FLAG_CLEAR_STOP 2
#define DRIVE_FLAG_BRAKE 4

#define STATE_FLAG_ARMED 1
#define STATE_FLAG_DEAD_MAN 2
#define STATE_FLAG_STOPPED 4
#define STATE_FLAG_BATTERY_LOW 8
#define STATE_FLAG_ENCODER_FAULT 16
#define STATE_FLAG_SATURATED 32
#define STATE_FLAG_FACTORY 64
#define STATE_FLAG_ON_MARK 128

#define RESET_CAUSE_POWER 1
#define RESET_CAUSE_EXTERNAL 2
#define RESET_CAUSE_BROWN_OUT 4
#define RESET_CAUSE_WATCHDOG 8
#define RESET_CAUSE_HUNG 64
#define RESET_CAUSE_WARM 128

#define DRIVER_L298N 1
#define DRIVER_TB6612 2
#define DRIVER_L293D 3

#define ENCODER_KIND_NONE 0
#define ENCODER_KIND_SINGLE 1
#define ENCODER_KIND_QUADRATURE 2

#define WIRING_LEFT_MOTOR_REVERSED 1
#define WIRING_RIGHT_MOTOR_REVERSED 2
#define WIRING_MOTORS_SWAPPED 4
#define WIRING_LEFT_ENCODER_REVERSED 8
#define WIRING_RIGHT_ENCODER_REVERSED 16
#define WIRING_ENCODERS_SWAPPED 32
#define WIRING_MARK_ACTIVE_LOW 64

#define MOST_PWM_HZ_L298N 20000
#define MOST_PWM_HZ_TB6612 25000
#define MOST_PWM_HZ_L293D 5000

typedef struct __attribute__((packed)) {
    uint16_t dead_zone_permille;
    uint16_t slope_permille;
    uint16_t kick_permille;
} wheel_curve_t;
#define WHEEL_CURVE_LENGTH 6
#define WHEEL_CURVE_DEAD_ZONE_PERMILLE_LEAST 0
#define WHEEL_CURVE_DEAD_ZONE_PERMILLE_MOST 700
#define WHEEL_CURVE_SLOPE_PERMILLE_LEAST 100
#define WHEEL_CURVE_SLOPE_PERMILLE_MOST 3000
#define WHEEL_CURVE_KICK_PERMILLE_LEAST 0
#define WHEEL_CURVE_KICK_PERMILLE_MOST 1000

typedef struct __attribute__((packed)) {
    uint8_t nonce;
    int16_t left_permille;
    int16_t right_permille;
    uint8_t flags;
    uint8_t ttl_10ms;
} drive_t;
#define DRIVE_LENGTH 7
#define DRIVE_LEFT_PERMILLE_LEAST -1000
#define DRIVE_LEFT_PERMILLE_MOST 1000
#define DRIVE_RIGHT_PERMILLE_LEAST -1000
#define DRIVE_RIGHT_PERMILLE_MOST 1000
#define DRIVE_FLAGS_LEAST 0
#define DRIVE_FLAGS_MOST 7

typedef struct __attribute__((packed)) {
    uint16_t dead_man_ms;
    uint8_t telemetry_ms;
    uint16_t slew_permille_per_ms;
    uint16_t pwm_hz;
    uint16_t least_battery_mv;
} config_t;
#define CONFIG_LENGTH 9
#define CONFIG_DEAD_MAN_MS_LEAST 50
#define CONFIG_DEAD_MAN_MS_MOST 1000
#define CONFIG_TELEMETRY_MS_LEAST 5
#define CONFIG_TELEMETRY_MS_MOST 250
#define CONFIG_SLEW_PERMILLE_PER_MS_LEAST 1
#define CONFIG_SLEW_PERMILLE_PER_MS_MOST 1000
#define CONFIG_PWM_HZ_LEAST 50
#define CONFIG_PWM_HZ_MOST 25000
#define CONFIG_LEAST_BATTERY_MV_LEAST 0
#define CONFIG_LEAST_BATTERY_MV_MOST 20000

typedef struct __attribute__((packed)) {
    uint32_t token;
} ping_t;
#define PING_LENGTH 4

#define STOP_LENGTH 0

#define ASK_INFO_LENGTH 0

typedef struct __attribute__((packed)) {
    uint8_t wiring;
    uint8_t driver;
    uint8_t encoders;
    uint8_t kick_ms;
    uint8_t dither_permille;
    uint8_t dither_ms;
    uint16_t battery_permille;
    wheel_curve_t curves[4];
} settings_t;
#define SETTINGS_LENGTH 32
#define SETTINGS_WIRING_LEAST 0
#define SETTINGS_WIRING_MOST 127
#define SETTINGS_DRIVER_LEAST 1
#define SETTINGS_DRIVER_MOST 3
#define SETTINGS_ENCODERS_LEAST 0
#define SETTINGS_ENCODERS_MOST 2
#define SETTINGS_KICK_MS_LEAST 0
#define SETTINGS_KICK_MS_MOST 100
#define SETTINGS_DITHER_PERMILLE_LEAST 0
#define SETTINGS_DITHER_PERMILLE_MOST 250
#define SETTINGS_DITHER_MS_LEAST 1
#define SETTINGS_DITHER_MS_MOST 50
#define SETTINGS_BATTERY_PERMILLE_LEAST 1000
#define SETTINGS_BATTERY_PERMILLE_MOST 11000

#define ASK_SETTINGS_LENGTH 0

typedef struct __attribute__((packed)) {
    uint32_t t_us;
    uint32_t mark_t_us;
    int32_t left_sum;
    int32_t right_sum;
    int32_t left_counts;
    int32_t right_counts;
    int16_t left_permille;
    int16_t right_permille;
    uint16_t battery_mv;
    uint16_t drive_age_ms;
    uint8_t nonce;
    uint8_t drive_seq;
    uint8_t flags;
    uint8_t mark_count;
    uint8_t bad_frames;
    uint8_t ignored_frames;
    uint8_t overruns;
} state_t;
#define STATE_LENGTH 39

typedef struct __attribute__((packed)) {
    uint32_t token;
    uint32_t t_us;
} pong_t;
#define PONG_LENGTH 8

typedef struct __attribute__((packed)) {
    uint8_t protocol;
    uint8_t nonce;
    uint8_t reset_cause;
    uint8_t version_major;
    uint8_t version_minor;
    uint8_t version_patch;
    uint8_t driver;
    uint8_t encoders;
    uint16_t boots;
    uint16_t least_free_ram;
    uint16_t bad_crc;
    uint16_t bad_shape;
    uint16_t wrong_nonce;
    uint16_t old_sequence;
    uint16_t out_of_range;
    uint16_t not_armed;
    config_t config;
} info_t;
#define INFO_LENGTH 33

#define CONFIG_DEFAULT {300, 10, 40, 5000, 0}
#define SETTINGS_DEFAULT {0, 1, 0, 0, 0, 5, 3000, {{0, 1000, 0}, {0, 1000, 0}, {0, 1000, 0}, {0, 1000, 0}}}
