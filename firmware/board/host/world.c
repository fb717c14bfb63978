/* SPDX-License-Identifier: Apache-2.0 */
#include "board/host/world.h"

#include "board/host/boot.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define STEP_S (WORLD_STEP_US * 1e-6)
#define SILENCE_US 45000 /* without pulses, until the servo lets go */
#define SLIP_DEG_S 350
#define LIE_DEG_S 5000
#define RECENT 20 /* steps: 2 ms */
#define LDR_STEPS 10
#define LDR_LEAST_LUX 0.01 /* below, an LDR gets no slower */
#define MOST_ANGLES 64
#define REFERENCE_C 25
#define MOST_DECADES 3

/* Uniform in -1 to 1 (xorshift). */
static double noise(struct world *world)
{
	world->random ^= world->random << 13;
	world->random ^= world->random >> 17;
	world->random ^= world->random << 5;
	return world->random / 2147483648.0 - 1;
}

/* Limits: data sheets of the ATmega328P (1.0 to 1.2 V; 2 counts) and the 74HC4067 (80 ohm typical
 * at 4.5 V, 9 ohm between channels; the spread of the type is an estimate). */
static void draw_spread(struct world *world)
{
	for (int i = 0; i < 10; i++) /* small seeds look alike at first */
		(void)noise(world);
	world->bandgap_mv = 1100 + 100 * noise(world);
	world->adc_offset_lsb = 2 * noise(world);
	double mux_ohm = 85 + 20 * noise(world);
	for (int i = 0; i < WORLD_LDRS; i++)
		world->ldr_mux_ohm[i] = mux_ohm + 4.5 * noise(world);
}

void world_init(struct world *world, uint32_t seed)
{
	*world = (struct world){
		.servo_zero_us = 800,
		.servo_gain_us_deg = 7.407,
		.servo_slew_deg_s = 530, /* 60 degrees in 0.17 s, geared 3:2 */
		.servo_tau_ms = 12,
		.servo_deadband_deg = 0.2,
		.servo_wake_ms = 60,
		.servo_low_deg = -42,
		.servo_high_deg = 232,
		.backlash_deg = 1,
		.comb_first_deg = -16.5,
		.comb_pitch_deg = 3,
		.comb_edges = 68,
		.feedback_zero = 0.15,
		.feedback_per_deg = 1 / 360.0,
		.feedback_noise_deg = 0.1,
		.supply_mv = 4700, /* of USB, behind the Nano's diode */
		.bandgap_settle_us = 10,
		.ldr_per_kelvin = 0.005,
		.temperature_c = REFERENCE_C,
		.ldr_memory_s = 1200,
		.ldr_dark_ohm = 1e6,
		.ldr_divider_ohm = 3300,
		.ldr_rise_ms = 20,
		.ldr_fall_ms = 30,
		.ldr_slowness = 0.5,
		.slow = 1,
		.dtr_resets = 1,
		.boot_loader = BOOT_OPTIBOOT_4_4,
		.boot_wait_ms = 1000,
		.index_a_forced = -1,
		.index_b_forced = -1,
		.feedback_forced = -1,
		.since_pulse_us = SILENCE_US,
		.shaft_deg = 37,
		.wheel_deg = 37,
		.random = seed ? seed : 1,
	};
	for (int i = 0; i < WORLD_LDRS; i++) {
		world->ldr_lux[i] = -1;
		world->ldr_mv[i] = 1000 + 100 * i;
		world->ldr_r10_ohm[i] = 14000;
		world->ldr_gamma[i] = 0.7;
		world->ldr_forced[i] = -1;
	}
	for (int i = 0; i < WORLD_HISTORY; i++)
		world->history_deg[i] = world->wheel_deg;
	draw_spread(world);
}

void world_pulse(struct world *world, double width_us)
{
	world->pulse_us = width_us;
	world->since_pulse_us = 0;
}

void world_power(struct world *world, bool on)
{
	world->powered = on;
}

static double limit(double value, double low, double high)
{
	return value < low ? low : value > high ? high : value;
}

static double towards(double value, double goal, double step)
{
	return limit(goal, value - step, value + step);
}

static void turn_servo(struct world *world)
{
	world->powered_us = world->powered ? world->powered_us + WORLD_STEP_US : 0;
	if (world->stuck || world->powered_us <= world->servo_wake_ms * 1000 ||
	    world->since_pulse_us >= SILENCE_US)
		return;
	double asked = (world->pulse_us - world->servo_zero_us) / world->servo_gain_us_deg;
	asked += world->servo_crooked_deg * sin(asked * M_PI / 90);
	asked = limit(asked, world->servo_low_deg, world->servo_high_deg);
	double error = asked - world->shaft_deg;
	if (fabs(error) < world->servo_deadband_deg)
		return;
	double speed = world->servo_slew_deg_s * world->slow;
	double wanted = error / (world->servo_tau_ms * 1e-3);
	world->shaft_deg += limit(wanted, -speed, speed) * STEP_S;
}

/* The shaft pushes the wheel upwards from below, downwards from one backlash above. */
static void turn_wheel(struct world *world)
{
	double before = world->slipped_deg;

	world->slipped_deg = towards(world->slipped_deg, world->slip_deg, SLIP_DEG_S * STEP_S);
	world->wheel_deg += world->slipped_deg - before;
	double driven = world->shaft_deg + world->slipped_deg;
	world->wheel_deg = limit(world->wheel_deg, driven, driven + world->backlash_deg);
}

static void see_index(struct world *world)
{
	double seen_deg = world->wheel_deg + world->lying_deg;
	double below = ceil((seen_deg - world->comb_first_deg) / world->comb_pitch_deg);
	unsigned quarter = (unsigned)limit(below, 0, world->comb_edges) & 3;
	unsigned levels = quarter ^ quarter >> 1;

	if (world->index_a_forced >= 0)
		levels = (levels & 2) | (world->index_a_forced != 0);
	if (world->index_b_forced >= 0)
		levels = (levels & 1) | (world->index_b_forced != 0) << 1;
	if (world->index_glitches >= 1) {
		world->index_glitches--;
		levels ^= (unsigned)world->index_glitches & 1;
	}
	world->index_levels = levels;
}

/* Of mains light, from its mean. */
static double flicker(const struct world *world)
{
	return 1 + world->flicker_share * sin(2 * M_PI * world->flicker_hz * world->t_us * 1e-6);
}

/* Share of the supply at the multiplexer's common pin, through a channel and so much before it. */
static double divided(const struct world *world, unsigned channel, double ohm)
{
	return world->ldr_divider_ohm /
	       (world->ldr_divider_ohm + world->ldr_mux_ohm[channel] + ohm);
}

/* Resistance against that of the data sheet: by temperature, and by the light of the time before,
 * whose logarithm is what the cell remembers. */
static double drift(struct world *world, int i)
{
	double step_s = LDR_STEPS * STEP_S, lux = fmax(world->ldr_felt_lux[i], 1e-6);
	double *rested = &world->ldr_rested_lux[i];

	if (*rested <= 0)
		*rested = lux;
	double decades = limit(log10(lux / *rested), -MOST_DECADES, MOST_DECADES);
	*rested *= pow(10, decades * (1 - exp(-step_s / world->ldr_memory_s)));
	return (1 + world->ldr_drift[i]) *
	       exp(world->ldr_per_kelvin * (world->temperature_c - REFERENCE_C) +
		   world->ldr_memory * decades);
}

static void light_ldrs(struct world *world)
{
	for (int i = 0; i < WORLD_LDRS; i++) {
		if (world->ldr_lux[i] < 0)
			continue;
		double lux = world->ldr_lux[i] * flicker(world);
		double *felt = &world->ldr_felt_lux[i];
		double tau_ms = (lux > *felt ? world->ldr_rise_ms : world->ldr_fall_ms) *
				pow(fmax(10 / fmax(fmax(lux, *felt), LDR_LEAST_LUX), 1),
				    world->ldr_slowness);
		*felt += (lux - *felt) * (1 - exp(-LDR_STEPS * WORLD_STEP_US * 1e-3 / tau_ms));
		double ohm = drift(world, i) * world->ldr_r10_ohm[i] *
			     pow(*felt / 10, -world->ldr_gamma[i]);
		world->ldr_mv[i] = 5000 * divided(world, i, fmin(ohm, world->ldr_dark_ohm));
	}
}

void world_behind(struct world *world, double us)
{
	world->behind_us = fmax(world->behind_us, us);
}

void world_step(struct world *world)
{
	world->t_us += WORLD_STEP_US;
	world->since_pulse_us += WORLD_STEP_US;
	world->lying_deg = towards(world->lying_deg, world->lie_deg, LIE_DEG_S * STEP_S);
	turn_servo(world);
	turn_wheel(world);
	see_index(world);
	world->history_at = (world->history_at + 1) % WORLD_HISTORY;
	world->history_deg[world->history_at] = world->wheel_deg;
	world->history_ns[world->history_at] = world->start_ns + (int64_t)(world->t_us * 1000);
	if (world->history_at % LDR_STEPS == 0)
		light_ldrs(world);
}

double world_ldr_mv(struct world *world, unsigned channel)
{
	if (world->select_stuck >= 1)
		channel &= ~(1U << ((unsigned)world->select_stuck - 1));
	if (channel >= WORLD_LDRS)
		return 0;
	if (world->ldr_forced[channel] >= 0)
		return world->ldr_forced[channel] * divided(world, channel, 0) * world->supply_mv;
	double light = world->ldr_lux[channel] < 0 ? flicker(world) : 1;
	double mv = light * world->ldr_mv[channel] * world->supply_mv / 5000;
	if (world->ldr_noise[channel] > 0)
		mv += world->ldr_noise[channel] * noise(world) * world->supply_mv;
	return limit(mv, 0, world->supply_mv);
}

double world_adc_mv(const struct world *world, double mv)
{
	return fmax(mv + world->adc_offset_lsb * world->supply_mv / 1024, 0);
}

double world_bandgap_mv(const struct world *world, double former_mv, double since_us)
{
	return world->bandgap_mv +
	       (former_mv - world->bandgap_mv) * exp(-since_us / world->bandgap_settle_us);
}

double world_feedback_mv(struct world *world)
{
	double seen_deg =
		world->wheel_deg + world->lying_deg + noise(world) * world->feedback_noise_deg;
	double share = world->feedback_zero + seen_deg * world->feedback_per_deg;

	if (!world->feedback_fitted)
		return 0;
	if (world->feedback_forced >= 0)
		share = world->feedback_forced;
	return limit(share, 0, 1) * world->supply_mv;
}

void world_recent(const struct world *world, double *low_deg, double *high_deg)
{
	*low_deg = *high_deg = world->wheel_deg;
	for (unsigned i = 0; i < RECENT; i++) {
		double deg = world->history_deg[(world->history_at - i) % WORLD_HISTORY];
		*low_deg = fmin(*low_deg, deg);
		*high_deg = fmax(*high_deg, deg);
	}
}

size_t world_line(struct world *world, uint8_t *bytes, size_t count)
{
	if (world->line_cut || world->line_unplugged)
		return 0;
	for (size_t i = 0; world->line_noise > 0 && i < count; i++) {
		if ((noise(world) + 1) / 2 < world->line_noise)
			bytes[i] ^= 1 + (world->random >> 8) % 255;
	}
	return count;
}

/* The last known angle at a time; false when that lies outside of what is known. */
static bool angle_at(const struct world *world, int64_t ns, double *deg)
{
	unsigned newest = world->history_at, nearer = 0, farther = WORLD_HISTORY - 1;

	if (ns > world->history_ns[newest] ||
	    ns < world->history_ns[(newest - farther) % WORLD_HISTORY])
		return false;
	while (nearer < farther) {
		unsigned middle = (nearer + farther) / 2;
		if (world->history_ns[(newest - middle) % WORLD_HISTORY] <= ns)
			farther = middle;
		else
			nearer = middle + 1;
	}
	*deg = world->history_deg[(newest - farther) % WORLD_HISTORY];
	return true;
}

static void answer_angles(const struct world *world, const long long *ns, int count, char *answer,
			  size_t answer_size)
{
	size_t used = 0;
	double deg;

	answer[0] = '\0';
	for (int i = 0; i < count; i++) {
		int64_t at_ns = ns[0] + (count > 1 ? (ns[1] - ns[0]) * i / (count - 1) : 0);
		if (!angle_at(world, at_ns, &deg)) {
			bool future = at_ns > world->history_ns[world->history_at];
			snprintf(answer, answer_size, "error: %s",
				 future ? "not yet" : "forgotten");
			return;
		}
		used += snprintf(answer + used, answer_size - used, "%s%.3f", i ? " " : "", deg);
	}
}

#define NUMBER(name)                                \
	{                                           \
#name, offsetof(struct world, name) \
	}
#define OF_LDR(k, name)                                                                       \
	{                                                                                     \
		"ldr" #k "_" #name, offsetof(struct world, ldr_##name) + (k) * sizeof(double) \
	}
#define LDR(k)                                                                                 \
	OF_LDR(k, lux), OF_LDR(k, mv), OF_LDR(k, r10_ohm), OF_LDR(k, gamma), OF_LDR(k, drift), \
		OF_LDR(k, mux_ohm), OF_LDR(k, forced), OF_LDR(k, rested_lux), OF_LDR(k, noise)
static const struct {
	const char *name;
	size_t offset;
} numbers[] = {
	NUMBER(servo_zero_us),
	NUMBER(servo_gain_us_deg),
	NUMBER(servo_slew_deg_s),
	NUMBER(servo_tau_ms),
	NUMBER(servo_deadband_deg),
	NUMBER(servo_wake_ms),
	NUMBER(servo_crooked_deg),
	NUMBER(servo_low_deg),
	NUMBER(servo_high_deg),
	NUMBER(backlash_deg),
	NUMBER(comb_first_deg),
	NUMBER(comb_pitch_deg),
	NUMBER(comb_edges),
	NUMBER(feedback_fitted),
	NUMBER(feedback_zero),
	NUMBER(feedback_per_deg),
	NUMBER(feedback_noise_deg),
	NUMBER(supply_mv),
	NUMBER(bandgap_mv),
	NUMBER(bandgap_settle_us),
	NUMBER(adc_offset_lsb),
	NUMBER(dtr_resets),
	NUMBER(boot_loader),
	NUMBER(boot_wait_ms),
	NUMBER(ldr_per_kelvin),
	NUMBER(temperature_c),
	NUMBER(ldr_memory),
	NUMBER(ldr_memory_s),
	NUMBER(ldr_dark_ohm),
	NUMBER(ldr_divider_ohm),
	NUMBER(ldr_rise_ms),
	NUMBER(ldr_fall_ms),
	NUMBER(ldr_slowness),
	NUMBER(flicker_hz),
	NUMBER(flicker_share),
	NUMBER(behind_us),
	NUMBER(stuck),
	NUMBER(slow),
	NUMBER(slip_deg),
	NUMBER(lie_deg),
	NUMBER(index_a_forced),
	NUMBER(index_b_forced),
	NUMBER(index_glitches),
	NUMBER(feedback_forced),
	NUMBER(select_stuck),
	NUMBER(line_noise),
	NUMBER(line_cut),
	NUMBER(line_unplugged),
	NUMBER(pulse_us),
	NUMBER(since_pulse_us),
	NUMBER(powered),
	NUMBER(shaft_deg),
	NUMBER(wheel_deg),
	NUMBER(slipped_deg),
	NUMBER(lying_deg),
	LDR(0),
	LDR(1),
	LDR(2),
	LDR(3),
	LDR(4),
	LDR(5),
	LDR(6),
	LDR(7),
	LDR(8),
};
#define NUMBERS (sizeof(numbers) / sizeof(numbers[0]))

static double *find(struct world *world, const char *name)
{
	for (size_t i = 0; i < NUMBERS; i++) {
		if (strcmp(numbers[i].name, name) == 0)
			return (double *)((char *)world + numbers[i].offset);
	}
	return NULL;
}

bool world_command(struct world *world, const char *line, char *answer, size_t answer_size)
{
	char name[40];
	double value;
	double *number;
	long long ns[2];
	int count;

	if (sscanf(line, "angles %lld %lld %d", &ns[0], &ns[1], &count) == 3) {
		if (count < 1 || count > MOST_ANGLES)
			snprintf(answer, answer_size, "error: 1 to %d angles", MOST_ANGLES);
		else
			answer_angles(world, ns, count, answer, answer_size);
		return true;
	}
	if (strcmp(line, "names") == 0) {
		size_t used = 0;
		answer[0] = '\0';
		for (size_t i = 0; i < NUMBERS && used < answer_size; i++)
			used += snprintf(answer + used, answer_size - used, "%s%s", i ? " " : "",
					 numbers[i].name);
		return true;
	}
	if (sscanf(line, "set %39s %lf", name, &value) == 2) {
		number = find(world, name);
		if (number)
			*number = value;
		snprintf(answer, answer_size, number ? "ok" : "error: no number %s", name);
		return true;
	}
	if (sscanf(line, "get %39s", name) == 1) {
		number = find(world, name);
		if (number)
			snprintf(answer, answer_size, "%.9g", *number);
		else
			snprintf(answer, answer_size, "error: no number %s", name);
		return true;
	}
	return false;
}
