/* SPDX-License-Identifier: Apache-2.0 */
#include "base/log.h"

#include <errno.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/text.h"

#define TEXT_BYTES 768
#define OBJECT_BYTES 200 /* leaves room for what happened and what to do */
#define STAGE_BYTES 64
#define KINDS 32
#define FIRST_WINDOW_NS (10 * LP_NS_PER_S)
#define LONGEST_WINDOW_NS (600 * LP_NS_PER_S)

/* One kind of message seen lately. */
struct kind {
	uint64_t key; /* 0: free */
	int64_t printed_ns;
	int64_t window_ns; /* quiet time after a print; grows while the fault lasts */
	uint64_t unprinted;
	enum lp_log_level level;
	char text[TEXT_BYTES];
};

static struct {
	pthread_mutex_t lock;
	enum lp_log_level level;
	int journal; /* -1: not asked yet */
	struct kind kinds[KINDS];
} the_log = {.lock = PTHREAD_MUTEX_INITIALIZER, .level = LP_LOG_INFO, .journal = -1};

const char *lp_strerror(int error)
{
	const char *text = strerrordesc_np(error < 0 ? -error : error);

	return text ? text : "unknown error";
}

void lp_log_set_level(enum lp_log_level level)
{
	pthread_mutex_lock(&the_log.lock);
	the_log.level = level;
	pthread_mutex_unlock(&the_log.lock);
}

/* systemd says in JOURNAL_STREAM which device and inode of standard error is the journal. */
static bool stderr_is_journal(void)
{
	const char *stream = getenv("JOURNAL_STREAM");
	char expected[64];
	struct stat status;

	if (!stream || fstat(STDERR_FILENO, &status) < 0)
		return false;
	(void)snprintf(expected, sizeof(expected), "%ju:%ju", (uintmax_t)status.st_dev,
		       (uintmax_t)status.st_ino);
	return strcmp(stream, expected) == 0;
}

static void print_line(enum lp_log_level level, const char *text, uint64_t repeats)
{
	static const char *const names[] = {"error ", "warning ", "info ", "debug "};
	static const char *const journal[] = {"<3>", "<4>", "<6>", "<7>"};
	char line[TEXT_BYTES + 64];
	int length;

	if (the_log.journal < 0)
		the_log.journal = stderr_is_journal();
	length = snprintf(line, sizeof(line), "%s%s",
			  the_log.journal ? journal[level] : names[level], text);
	if (repeats)
		length += snprintf(line + length, sizeof(line) - (size_t)length,
				   " (%ju times more)", (uintmax_t)repeats);
	line[length++] = '\n';
	if (write(STDERR_FILENO, line, (size_t)length) < 0)
		return; /* nobody listens: there is no other place to say so */
}

static uint64_t hash(uint64_t seed, const char *text)
{
	/* FNV-1a, the terminator included so that "ab","c" and "a","bc" differ. */
	do {
		seed = (seed ^ (uint8_t)*text) * 0x100000001b3U;
	} while (*text++);
	return seed;
}

static void print_count(struct kind *kind, int64_t now_ns)
{
	print_line(kind->level, kind->text, kind->unprinted);
	kind->unprinted = 0;
	kind->printed_ns = now_ns;
	if (kind->window_ns < LONGEST_WINDOW_NS)
		kind->window_ns *= 4;
}

/* The entry of `key`, or the oldest one emptied for it. */
static struct kind *find_kind(uint64_t key, int64_t now_ns)
{
	struct kind *oldest = &the_log.kinds[0];

	for (int i = 0; i < KINDS; i++) {
		if (the_log.kinds[i].key == key)
			return &the_log.kinds[i];
		if (the_log.kinds[i].printed_ns < oldest->printed_ns)
			oldest = &the_log.kinds[i];
	}
	if (oldest->unprinted)
		print_count(oldest, now_ns);
	*oldest = (struct kind){.key = key, .window_ns = FIRST_WINDOW_NS};
	return oldest;
}

/* A kind that was quiet for longer than its window is news again. */
static void print_or_count(enum lp_log_level level, uint64_t key, const char *text)
{
	const int64_t now_ns = lp_clock_ns();
	struct kind *kind = find_kind(key, now_ns);

	kind->level = level;
	(void)snprintf(kind->text, sizeof(kind->text), "%s", text);
	if (kind->printed_ns && now_ns - kind->printed_ns < kind->window_ns) {
		kind->unprinted++;
		return;
	}
	if (kind->unprinted) {
		print_count(kind, now_ns);
		return;
	}
	print_line(level, text, 0);
	kind->printed_ns = now_ns;
	kind->window_ns = FIRST_WINDOW_NS;
}

void lp_log(enum lp_log_level level, const char *object, const char *stage, const char *reason, ...)
{
	const int saved_errno = errno;
	char text[TEXT_BYTES], line[TEXT_BYTES];
	va_list arguments;
	int length;

	pthread_mutex_lock(&the_log.lock);
	if (level > the_log.level)
		goto unlock;
	lp_text_copy(text, OBJECT_BYTES, object);
	length = (int)strlen(text);
	length += snprintf(text + length, STAGE_BYTES, ": %.*s: ", STAGE_BYTES - 5, stage);
	errno = saved_errno; /* for %m */
	va_start(arguments, reason);
	(void)vsnprintf(text + length, sizeof(text) - (size_t)length, reason, arguments);
	va_end(arguments);
	lp_text_copy(line, sizeof(line), text); /* one line, whatever a client sent */
	if (strcmp(reason, "%s") == 0)
		reason = line; /* the kind of reason is in the text alone */
	if (level == LP_LOG_DEBUG)
		print_line(level, line, 0);
	else
		print_or_count(level,
			       hash(hash(hash(0xcbf29ce484222325U + (uint64_t)level, object),
					 stage),
				    reason),
			       line);
unlock:
	pthread_mutex_unlock(&the_log.lock);
	errno = saved_errno;
}

void lp_log_flush(int all)
{
	const int64_t now_ns = lp_clock_ns();

	pthread_mutex_lock(&the_log.lock);
	for (int i = 0; i < KINDS; i++) {
		struct kind *kind = &the_log.kinds[i];

		if (kind->unprinted && (all || now_ns - kind->printed_ns >= kind->window_ns))
			print_count(kind, now_ns);
	}
	pthread_mutex_unlock(&the_log.lock);
}
