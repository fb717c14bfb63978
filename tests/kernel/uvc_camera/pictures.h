/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Where frames come from. Three kinds, chosen by a URI:
 *
 *	pattern:	drawn here: columns of rising radiance and a lamp, exposed as asked for
 *	folder:PATH	files WIDTHxHEIGHT_EXPOSUREus_N.EXT (ext jpg, yuyv, nv12, grey); of the
 *right format and size, those whose exposure (times gain) is nearest, in order of N sim:PATH?QUERY
 *the simulator's socket (proto/sim.md): it makes each frame for the exposure that it is told, at
 *its own pace; QUERY goes into `hello`
 */
#ifndef UVC_CAMERA_PICTURES_H
#define UVC_CAMERA_PICTURES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "controls.h"
#include "model.h"

struct pictures;

/* Owned by the pictures; valid until the next pictures_take() or pictures_destroy(). */
struct picture {
	const uint8_t *data;
	size_t size_bytes;
};

struct pictures_ops {
	int (*take)(struct pictures *pictures, enum camera_format format,
		    const struct camera_size *size, const struct settings *settings,
		    struct picture *picture);
	void (*destroy)(struct pictures *pictures);
};

/* Base of every kind: embed it as the first member. */
struct pictures {
	const struct pictures_ops *ops;
	bool paced; /* take() waits for the next frame; else the caller keeps the frame rate */
};

/* NULL, after saying why, when the URI is wrong or its files are not there. */
struct pictures *pictures_create(const char *uri);
struct pictures *pictures_pattern_create(void);
struct pictures *pictures_folder_create(const char *path);
struct pictures *pictures_simulator_create(const char *path_and_query);

/* -ENOENT: no such picture. -EINTR: a signal came while waiting. One thread at a time. */
int pictures_take(struct pictures *pictures, enum camera_format format,
		  const struct camera_size *size, const struct settings *settings,
		  struct picture *picture);
void pictures_destroy(struct pictures *pictures); /* accepts NULL */

#endif
