// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using System.Threading;

namespace Lightprobe
{
    /// <summary>
    /// Until when all that has arrived has also been read. After a pause of the app (a phone sleeps, a debugger halts it)
    /// messages wait in the system's buffers, and the app may look before the client's thread has read them. What is the
    /// newest by then says nothing of what the probe has sent. So age and silence are judged at the last moment of which it is
    /// known that all that had come by then was read.
    /// </summary>
    internal sealed class Drained : IDisposable
    {
        /// <summary>So often a turn is noted, and so many turns it takes until what waited before them has been read.</summary>
        internal const int PeriodMs = 50, Turns = 3;

        private readonly Func<double> _nowMs;
        private readonly Queue<double> _turnsMs = new Queue<double>();
        private Timer _timer;

        /// <param name="nowMs">A clock in milliseconds that nobody sets.</param>
        internal Drained(Func<double> nowMs)
        {
            _nowMs = nowMs;
            Turn();
        }

        /// <summary>Notes turns from now on, until Dispose.</summary>
        internal void Start()
        {
            // Each turn begins the wait for the next: after a pause none comes sooner.
            _timer = new Timer(_ =>
            {
                Turn();
                lock (_turnsMs) _timer?.Change(PeriodMs, Timeout.Infinite);
            });
            lock (_turnsMs) _timer.Change(PeriodMs, Timeout.Infinite);
        }

        /// <summary>All that came before this time of the clock has been read.</summary>
        internal double UntilMs { get { lock (_turnsMs) return _turnsMs.Count > 0 ? _turnsMs.Peek() : _nowMs(); } }

        internal void Turn()
        {
            lock (_turnsMs)
            {
                _turnsMs.Enqueue(_nowMs());
                if (_turnsMs.Count > Turns) _turnsMs.Dequeue();
            }
        }

        /// <summary>Nothing is read any more: UntilMs is now.</summary>
        public void Dispose()
        {
            lock (_turnsMs)
            {
                _timer?.Dispose();
                _timer = null;
                _turnsMs.Clear();
            }
        }
    }
}
