/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Walking through the entropy-coded blocks of a JPEG without decoding them: where each ends, and
 * the energy of its AC coefficients. Internal to the reader (vision/jpeg/blocks.h).
 *
 * A walk is a chain of table lookups, each of which tells where the next one begins: most of its
 * time is waiting. Two walks at different places of the stream, in turns, take little longer than
 * one.
 */
#ifndef LP_VISION_JPEG_WALK_H
#define LP_VISION_JPEG_WALK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "vision/jpeg/huffman.h"

/* Blocks of an MCU: 2 x 2 luma, 2 chroma. */
#define LP_JPEG_SLOTS 6
/* A walk may go on for less than this many blocks after its last. */
#define LP_JPEG_WALK_MARGIN 4
/* Bytes behind the end of a stream that walks may read. */
#define LP_JPEG_WALK_PADDING 256

/* A block of the MCU: how it is coded, and which comes next. */
struct lp_jpeg_slot {
	const struct lp_jpeg_slot *next[2]; /* after a step inside the block, and after its last */
	const struct lp_probes *inside;	    /* for what follows its head */
	intptr_t to_head; /* bytes from those to the ones of the next one's head */
	const struct lp_huffman *dc_code, *ac_code;
};

/* What the walks through one frame share. */
struct lp_jpeg_path {
	struct lp_jpeg_slot slot[LP_JPEG_SLOTS];
	int slots;
	const uint8_t *stream;
	/* squared quantisers of luma in zigzag order; zeros behind them, for what is looked up in
	 * vain */
	uint32_t weight[128];
};

/* A block that has been passed. */
struct lp_jpeg_mark {
	uint32_t end_bit; /* of the stream */
	/* of all blocks up to there: sum of the squared dequantised AC values, in LP_ENERGY_STEPS,
	 * modulo 2^32; what chroma adds is nonsense */
	uint32_t energy;
};

/* All in one place: the steps keep it in registers. */
struct lp_jpeg_walk {
	const uint8_t *next; /* of the stream */
	uint32_t next_bit;   /* of the stream: where that is; those up to there are in the window */
	uint64_t window;     /* the next bits, most significant first */
	uint32_t bit;	     /* of the stream: where that is */
	uint32_t energy;     /* of all blocks so far */
	uint32_t coefficient; /* the next one, << LP_PASSED_COEFFICIENT; 0: a block's head */
	const struct lp_probes *probes; /* for the next step */
	const struct lp_jpeg_slot *slot;
	struct lp_jpeg_mark *mark;	      /* of the block */
	struct lp_jpeg_mark *last;	      /* the walk ends before this one, */
	uint32_t limit_bit;		      /* or once it is there, */
	const struct lp_jpeg_mark *broken_at; /* or at what is no code, of this block; else NULL */
};

/* At the first block of an MCU. `marks` have room for LP_JPEG_WALK_MARGIN more than `blocks`. */
void lp_jpeg_walk_begin(struct lp_jpeg_walk *walk, const struct lp_jpeg_path *path, uint32_t bit,
			uint32_t limit_bit, struct lp_jpeg_mark *marks, size_t blocks);

static inline bool lp_jpeg_walk_ended(const struct lp_jpeg_walk *walk)
{
	return walk->mark >= walk->last || walk->bit >= walk->limit_bit;
}

/* It came upon what is no code, and not just behind its last block. */
static inline bool lp_jpeg_walk_failed(const struct lp_jpeg_walk *walk)
{
	return walk->broken_at && walk->broken_at < walk->last;
}

/* All its blocks are passed. */
static inline bool lp_jpeg_walk_is_whole(const struct lp_jpeg_walk *walk)
{
	return walk->mark >= walk->last && !lp_jpeg_walk_failed(walk);
}

/* To its end. */
void lp_jpeg_walk_on(struct lp_jpeg_walk *walk, const struct lp_jpeg_path *path);

/* In turns, until one has ended. */
void lp_jpeg_walk_both(struct lp_jpeg_walk *one, struct lp_jpeg_walk *other,
		       const struct lp_jpeg_path *path);

#endif
