/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Messages to standard error, one line each, whatever is in them (base/text.h): "<level> object:
 * stage: reason". Under systemd the level is written as the journal's "<N>" prefix instead.
 *
 * A fault that repeats (same object, stage and reason but for what is filled into the reason's
 * format; of "%s", the text itself) is printed once, then counted; the count follows with the next
 * line that is printed, at first after ten seconds, later more rarely. The process has one standard
 * error, hence one log: the only global state of the daemon. Any thread may log; errno is
 * preserved.
 */
#ifndef LP_BASE_LOG_H
#define LP_BASE_LOG_H

enum lp_log_level {
	LP_LOG_ERROR,
	LP_LOG_WARNING,
	LP_LOG_INFO,
	LP_LOG_DEBUG, /* never counted away */
};

/* Prints `level` and what is more severe. Default: LP_LOG_INFO. */
void lp_log_set_level(enum lp_log_level level);

/* `reason` says what happened and the next step: "device busy - is another program using it?". */
__attribute__((format(printf, 4, 5))) void lp_log(enum lp_log_level level, const char *object,
						  const char *stage, const char *reason, ...);

/* Print the counts of repeated messages that are due; call it every few seconds, and at exit
 * with `all` set. */
void lp_log_flush(int all);

/* Text of an error: takes errno or -errno; thread-safe; static storage. */
const char *lp_strerror(int error);

#define lp_error(...) lp_log(LP_LOG_ERROR, __VA_ARGS__)
#define lp_warning(...) lp_log(LP_LOG_WARNING, __VA_ARGS__)
#define lp_info(...) lp_log(LP_LOG_INFO, __VA_ARGS__)
#define lp_debug(...) lp_log(LP_LOG_DEBUG, __VA_ARGS__)

#endif
