/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The box around the microcontroller, simulated: servo and wheel, its comb under two sensors,
 * feedback voltage, nine LDR voltages, supply. Used by the host build and around simavr
 * (firmware/simavr).
 *
 * Every number has a name and can be set and read as text while it runs: that is how faults are
 * made. Units are in the names; angles are wheel degrees unless they say shaft.
 */
#ifndef WORLD_H
#define WORLD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define WORLD_STEP_US 100
#define WORLD_LDRS 9
#define WORLD_HISTORY 32768 /* steps of the wheel's angle kept: 3.3 s */

struct world {
	/* Servo: pulse to wheel angle (with its gear), and how it moves. */
	double servo_zero_us, servo_gain_us_deg;
	double servo_slew_deg_s;
	double servo_tau_ms; /* approach to the asked angle */
	double servo_deadband_deg;
	double servo_wake_ms;	  /* from power to the first turn: slow switch, its own start */
	double servo_crooked_deg; /* amplitude of the angle's error over the range */
	double servo_low_deg, servo_high_deg; /* mechanical stops */
	double backlash_deg;
	/* The comb, as built: lowest edge, distance from edge to edge, number. */
	double comb_first_deg, comb_pitch_deg, comb_edges;
	/* Feedback: share of the supply at 0 degrees and per degree; fitted or not. */
	double feedback_fitted, feedback_zero, feedback_per_deg, feedback_noise_deg;
	/* The chip's reference (data sheet: 1.0 to 1.2 V) and its ADC's offset (2 counts). After
	 * the ADC is switched to the reference, the voltage that it sees gets there with a time
	 * constant. */
	double supply_mv, bandgap_mv, bandgap_settle_us, adc_offset_lsb;
	/* LDRs from the supply to the multiplexer's channels, a resistor from its common pin to
	 * ground. What an LDR feels follows the illuminance with a first-order lag;
	 * R = (1 + drift) r10 (felt / 10 lux)^-gamma, times e^(per_kelvin (temperature - 25))
	 * and e^memory for each decade of light above that of the time before
	 * (host_py/lightprobe/sim/ldr.py names the sources). */
	double ldr_lux[WORLD_LDRS]; /* -1: the voltage is set, not the light */
	double ldr_mv[WORLD_LDRS];  /* of the common pin, at a supply of 5 V */
	double ldr_r10_ohm[WORLD_LDRS], ldr_gamma[WORLD_LDRS];
	double ldr_drift[WORLD_LDRS];	/* of R10, by temperature and former light */
	double ldr_mux_ohm[WORLD_LDRS]; /* the channel's on-resistance */
	double ldr_per_kelvin, temperature_c;
	double ldr_memory;   /* relative; 0: none */
	double ldr_memory_s; /* time constant of the light of the time before */
	double ldr_dark_ohm, ldr_divider_ohm;
	double ldr_rise_ms, ldr_fall_ms; /* at 10 lux; the darker, the slower, by this power */
	double ldr_slowness;
	double flicker_hz, flicker_share; /* of the light on all LDRs, sinusoidal */

	/* Faults. */
	double stuck;	 /* 1: the servo cannot turn */
	double slow;	 /* factor on the slew; 1: healthy */
	double slip_deg; /* the wheel has slipped by so much in all (it gets there at 350 deg/s) */
	double lie_deg;	 /* the sensors see the wheel so far ahead (at 5000 deg/s) */
	double index_a_forced, index_b_forced; /* -1: real; 0: never on a tooth; 1: always */
	double index_glitches;	       /* changes of sensor A, one a step, still to be made */
	double feedback_forced;	       /* -1: real; else this share of the supply */
	double ldr_forced[WORLD_LDRS]; /* -1: real; else the share of the supply before the
					  multiplexer: 0 open, 1 shorted */
	double ldr_noise[WORLD_LDRS];  /* of each conversion, uniform, this share of the supply to
					  both sides: a loose contact */
	double select_stuck;	       /* 1 to 4: this select line of the multiplexer, S0 to S3,
					  stays low; 0: none */
	double line_noise;	       /* share of the serial line's bytes that are changed */
	double line_cut;	       /* 1: none passes */
	double line_unplugged;	       /* 1: the serial device is not there */

	/* What an Arduino Nano does when a program opens its serial line (boot.h). */
	double dtr_resets;   /* 1: the line's DTR resets the microcontroller */
	double boot_loader;  /* enum boot_loader */
	double boot_wait_ms; /* the boot loader waits so long for a programmer */

	/* State. */
	double t_us;
	int64_t start_ns; /* CLOCK_MONOTONIC when t_us was 0; 0 in lock-step. Grows when time is
			   * lost
			   */
	/* How far the box has been behind the clock, at most since somebody set it to 0: what its
	 * wheel did then it did later than `angles` says. */
	double behind_us;
	double ldr_felt_lux[WORLD_LDRS];
	double ldr_rested_lux[WORLD_LDRS]; /* light of the time before; 0: as at first */
	double pulse_us;		   /* of the last pulse */
	double since_pulse_us;
	double powered;
	double powered_us; /* for so long */
	double shaft_deg, wheel_deg, slipped_deg, lying_deg;
	uint8_t index_levels; /* bit 0: A on a tooth, bit 1: B */
	uint32_t random;
	double history_deg[WORLD_HISTORY];
	int64_t history_ns[WORLD_HISTORY]; /* CLOCK_MONOTONIC */
	unsigned history_at;
};

/* The box is so far behind the clock now. */
void world_behind(struct world *world, double us);

/* Whatever differs from box to box (reference, ADC, multiplexer) is drawn from the seed. */
void world_init(struct world *world, uint32_t seed);

/* The servo's pins: a pulse has ended; the supply switch. */
void world_pulse(struct world *world, double width_us);
void world_power(struct world *world, bool on);

/* Goes on by WORLD_STEP_US. */
void world_step(struct world *world);

/* What the pins see. */
double world_ldr_mv(struct world *world, unsigned channel);
double world_feedback_mv(struct world *world);

/* What the ADC makes of a voltage, as a voltage: its offset added, never below 0. */
double world_adc_mv(const struct world *world, double mv);

/* What the ADC sees of the chip's reference, so long after it was switched there from a pin. */
double world_bandgap_mv(const struct world *world, double former_mv, double since_us);

/* Least and greatest angle of the last 2 ms. */
void world_recent(const struct world *world, double *low_deg, double *high_deg);

/* What the serial line makes of bytes that pass; gives how many are left. */
size_t world_line(struct world *world, uint8_t *bytes, size_t count);

/* In real time: more than this a machine may lag before time is forgotten. A lost moment looks to
 * the host as if the microcontroller's clock had jumped, which no real one does. */
#define WORLD_BEHIND_US 2000000

/*
 * "angles FROM_NS TO_NS COUNT": the wheel's angle at COUNT (1…64) times from FROM_NS to TO_NS of
 * CLOCK_MONOTONIC; "error: not yet" or "error: forgotten" outside of what is known.
 * "set NAME VALUE", "get NAME", "names": false when the line is none of these. The answer has no
 * newline. */
bool world_command(struct world *world, const char *line, char *answer, size_t answer_size);

#endif
