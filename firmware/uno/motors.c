#include "motors.h"

#include "board.h"
#include "settings.h"
#include "telemetry.h"

#define DEAD_MAN_SLEW 100 /* per mille per millisecond, at least: from full duty to 0 in 10 ms */
#define BATTERY_EVERY 16  /* ticks between two tests of the battery */
#define BATTERY_LOW_MS 2000
#define BATTERY_WELL_MV 200 /* above the limit, before the motors are permitted again */

typedef struct {
    int16_t request; /* of the last command */
    int16_t now;     /* the request after slew and reversal */
    uint8_t kick;    /* remaining ticks of the kick, and one to end it */
    uint8_t rest;    /* remaining ticks at zero before a start */
} wheel_t;

static wheel_t wheels[2];
uint8_t motors_armed, motors_dead_man, motors_stopped, motors_saturated, motors_battery_low;
static uint16_t patience_ms; /* dead-man time of the last command */
static uint8_t brake, rest_ticks, dither_left, dither_up;
static uint16_t battery_raw16, battery_low_ms; /* raw: 16 times the mean reading */

uint16_t motors_most_pwm_hz(uint8_t driver) {
    return driver == DRIVER_TB6612 ? MOST_PWM_HZ_TB6612 : driver == DRIVER_L298N ? MOST_PWM_HZ_L298N : MOST_PWM_HZ_L293D;
}

static void show(uint8_t wheel, int16_t duty) {
    uint8_t channel = settings.wiring & WIRING_MOTORS_SWAPPED ? !wheel : wheel;
    OF_WHEEL(permille, wheel) = duty;
    if (duty != 1000 && duty != -1000) motors_saturated &= ~(1 << wheel);
    if (!duty) {
        board_rest(channel, settings.driver, brake);
        return;
    }
    board_drive(channel, settings.wiring & WIRING_LEFT_MOTOR_REVERSED << wheel ? -duty : duty);
}

static void to_zero(void) {
    for (uint8_t k = 0; k < 2; k++) {
        if (OF_WHEEL(permille, k)) wheels[k].rest = rest_ticks;
        wheels[k].now = 0;
        show(k, 0);
    }
}

void motors_begin(void) {
    static const config_t usual = CONFIG_DEFAULT;
    state.drive_age_ms = NO_AGE;
    motors_configure(&usual);
}

void motors_arm(void) {
    motors_armed = 1;
    board_bridge(1);
}

void motors_disarm(void) {
    motors_armed = brake = 0;
    wheels[LEFT].request = wheels[RIGHT].request = 0;
    to_zero();
    board_bridge(0);
}

void motors_stop(void) {
    motors_stopped = 1;
    motors_disarm();
}

void motors_set(const drive_t *drive) {
    wheels[LEFT].request = drive->left_permille;
    wheels[RIGHT].request = drive->right_permille;
    brake = (drive->flags & DRIVE_FLAG_BRAKE) != 0;
    patience_ms = info.config.dead_man_ms;
    if (drive->ttl_10ms && drive->ttl_10ms * 10U < patience_ms) patience_ms = drive->ttl_10ms * 10U;
    state.drive_age_ms = 0;
    if (motors_dead_man) board_bridge(1);
    motors_dead_man = 0;
}

void motors_configure(const config_t *c) {
    uint16_t most = motors_most_pwm_hz(settings.driver), before = info.config.pwm_hz;
    info.config = *c;
    if (info.config.pwm_hz > most) info.config.pwm_hz = most;
    if (info.config.pwm_hz == before) return;
    to_zero(); /* the timer restarts, and so do the wheels */
    rest_ticks = 2 + 1000 / info.config.pwm_hz; /* the timer applies a new duty only at the end of a period */
    board_pwm_hz(info.config.pwm_hz);
}

static int16_t stepped(int16_t now, int16_t goal, int16_t slew) {
    if ((now > 0 && goal < 0) || (now < 0 && goal > 0)) goal = 0; /* reverse only through zero */
    if (goal > now + slew) return now + slew;
    if (goal < now - slew) return now - slew;
    return goal;
}

/* Return the duty for the request `now`: with dead zone, slope, kick and dither. */
static int16_t mapped(wheel_t *w, uint8_t wheel) {
    const wheel_curve_t *curve = &settings.curves[2 * wheel + (w->now < 0)];
    uint16_t size = w->now < 0 ? -w->now : w->now;
    int16_t duty = curve->dead_zone_permille + (uint16_t)((uint32_t)size * curve->slope_permille / 1000);
    if (w->kick && --w->kick && duty < (int16_t)curve->kick_permille) duty = curve->kick_permille;
    duty += dither_up ? settings.dither_permille : -settings.dither_permille;
    if (duty < 0) duty = 0;
    if (duty > 1000) {
        duty = 1000;
        motors_saturated |= 1 << wheel;
    }
    return w->now < 0 ? -duty : duty;
}

static void wheel_tick(uint8_t wheel, int16_t slew) {
    wheel_t *w = &wheels[wheel];
    int16_t was = w->now, *duty = &OF_WHEEL(permille, wheel);
    if (w->rest) w->rest--;
    else w->now = stepped(was, w->request, slew);
    if (!w->now) {
        if (*duty) w->rest = rest_ticks;
        w->kick = settings.kick_ms + 1;
        show(wheel, 0);
    } else if (w->now != was || w->kick || settings.dither_permille) {
        show(wheel, mapped(w, wheel));
    }
    OF_WHEEL(sum, wheel) += *duty;
}

static void battery_tick(void) {
    static uint8_t wait;
    uint16_t raw = board_battery();
    battery_raw16 = battery_raw16 ? battery_raw16 + raw - battery_raw16 / 16 : 16 * raw;
    if (wait--) return;
    wait = BATTERY_EVERY - 1;
    uint32_t mv = (uint32_t)battery_raw16 * 5 / 16 * settings.battery_permille / 1023;
    state.battery_mv = mv > 65535 ? 65535 : (uint16_t)mv;
    uint16_t least = info.config.least_battery_mv;
    if (state.battery_mv >= least) {
        battery_low_ms = 0;
        if (!least || state.battery_mv - least >= BATTERY_WELL_MV) motors_battery_low = 0;
    } else if (battery_low_ms < BATTERY_LOW_MS) {
        battery_low_ms += BATTERY_EVERY;
    } else {
        motors_battery_low = 1;
        if (motors_armed) motors_disarm();
    }
}

void motors_tick(void) {
    battery_tick();
    if (state.drive_age_ms != NO_AGE) state.drive_age_ms++;
    int16_t slew = info.config.slew_permille_per_ms;
    if (motors_armed && state.drive_age_ms > patience_ms) {
        motors_dead_man = 1;
        brake = 0;
        wheels[LEFT].request = wheels[RIGHT].request = 0;
        if (slew < DEAD_MAN_SLEW) slew = DEAD_MAN_SLEW;
    }
    if (!dither_left--) {
        dither_left = settings.dither_ms - 1;
        dither_up = !dither_up;
    }
    if (motors_armed) {
        wheel_tick(LEFT, slew);
        wheel_tick(RIGHT, slew);
        if (motors_dead_man && !state.left_permille && !state.right_permille) board_bridge(0);
    }
}
