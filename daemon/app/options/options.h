/* SPDX-License-Identifier: Apache-2.0 */
/* What a user can choose: one table for command line, configuration file, help and defaults. */
#ifndef LP_APP_OPTIONS_OPTIONS_H
#define LP_APP_OPTIONS_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "app/run/governor.h"
#include "base/log.h"
#include "base/param.h"
#include "base/uri.h"
#include "estimate/pipeline.h"

#define LP_MAX_PUBLISHERS 8

struct lp_uri_texts {
	int count;
	char texts[LP_MAX_PUBLISHERS][LP_URI_MAX_BYTES];
};

/* One of each for every camera, in the same order. */
struct lp_camera_texts {
	int count;
	char texts[LP_MAX_CAMERAS][LP_URI_MAX_BYTES];
};

/* --orientation */
struct lp_orientation_choice {
	enum lp_orientation_kind kind;
	char uri[LP_URI_MAX_BYTES]; /* of the sensor */
};

/* How the angles of the wheel are used. */
struct lp_polarizer {
	enum { LP_POLARIZER_OFF, LP_POLARIZER_SWEEP, LP_POLARIZER_FIXED, LP_POLARIZER_FILMS } mode;
	float fixed_deg;
};

struct lp_options {
	struct lp_camera_texts source;
	struct lp_uri_texts publish;
	struct lp_camera_texts camera; /* as many as sources; or one of less, or none: equirect */
	int preset;		       /* enum lp_preset */
	int panorama_width_px;
	int decode_divisor;		/* 0: as the preset says; LP_DECODE_BY_BLOCKS */
	int exact_blocks, refine_cells; /* 0: as the preset says; LP_NONE */
	struct lp_governor_goals goals;
	struct lp_detector_options detector;
	int sh_order, lights;
	bool area_lights, key_light;
	int reflection_size; /* the largest that clients may ask for; 0: none */
	struct lp_orientation_choice orientation;
	char mount[1024]; /* file; "": identity */
	float smoothing_ms, ttl_ms;
	int brackets;			/* most exposures of a bracket; 0: exposure is left alone */
	float exposure_us, gain;	/* commanded of a source that can; 0: left alone */
	char rotator[LP_URI_MAX_BYTES]; /* "": none */
	char ring[LP_URI_MAX_BYTES];	/* "": none */
	struct lp_floats ring_lux;	/* --once: its readings beside the pictures */
	float ring_rgb[9][3];		/* likewise, of red, green and blue */
	bool has_ring_rgb;
	float ring_colour_sigma;		    /* of these, relative */
	struct lp_floats ring_sigma;		    /* of these, relative: one for all, or nine */
	float cd_m2_per_unit, cd_m2_per_unit_sigma; /* 0: not known */
	struct lp_floats wheel_angles_deg;
	struct lp_polarizer polarizer;
	float polarizer_transmission, polarizer_extinction; /* 0: as the camera file says */
	float polarizer_offset_deg, polarizer_rest_s;
	float polarizer_index; /* 0: as the camera file says */
	float wheel_dwell_ms;
	int max_clients;
	char name[64]; /* of the probe; "": the host's */
	bool insecure_lan;
	bool publish_polarization; /* clients may ask for pictures of it */
	int log_level;		   /* enum lp_log_level */
	char config[1024];
	char series[1024]; /* folder; empty: estimate */
	struct lp_floats series_us;
	int series_frames;
	char simulated_time[108]; /* socket of a test; empty: the system's time */
	bool once, version, help, help_once, help_backends, check_config;
};

/*
 * Defaults, then the configuration file if one is named, then the command line; what is missing is
 * completed (publishers). -EINVAL or the file's error, logged with what is known and the next step.
 */
int lp_options_read(struct lp_options *options, int argc, char **argv);

/* One configuration file in memory, `name` for messages. 0 or -EBADMSG, logged as FILE:LINE. */
int lp_options_read_config(struct lp_options *options, const char *name, const char *text,
			   size_t size_bytes);

void lp_options_defaults(struct lp_options *options);

/* The options' part of --help. */
void lp_options_help(FILE *out);

/* --help-once */
void lp_options_help_once(FILE *out);

/* The camera file of a source; "equirect" where none is named. */
const char *lp_options_camera(const struct lp_options *options, int source);

/* Options of the pipeline, but for the cameras and the film before it. */
struct lp_pipeline_options lp_options_pipeline(const struct lp_options *options);

const char *lp_preset_name(int preset);
const char *lp_orientation_name(int orientation);

#endif
