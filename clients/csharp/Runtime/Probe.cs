// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Net.Sockets;
using System.Net.WebSockets;
using System.Threading;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>What a client is doing.</summary>
    public enum ProbeState
    {
        /// <summary>No greeting has come yet.</summary>
        Connecting,
        /// <summary>The probe has greeted.</summary>
        Open,
        /// <summary>Until the next attempt.</summary>
        Waiting,
        /// <summary>For good: Dispose was called, or the probe speaks another protocol.</summary>
        Closed,
    }

    /// <summary>
    /// A client of one probe. It connects, and connects again when the connection is lost; the newest estimate wins.
    /// A thread of its own does the work. Every member may be used from any thread, and none of them waits, but
    /// <see cref="WaitForNext"/>. Messages that it has given out do not change any more.
    /// </summary>
    public sealed class Probe : IDisposable
    {
        private const uint ProtocolMajor = 1, MinorWithNumbers = 1, MinorWithPings = 3;
        private const int FirstBackoffMs = 100, LastBackoffMs = 5000, ConnectMs = 5000, LeastPatienceMs = 5000;
        /// <summary>Of an Error in place of a Hello: the token is missing or wrong (EACCES).</summary>
        private const int TokenRefused = -13;
        /// <summary>After that. The daemon forgets a wrong token in a minute; several of an address bar all.</summary>
        private const int TokenBackoffMs = 80_000;
        /// <summary>Of how many estimates the fastest tells how far the probe's clock is off.</summary>
        private const int ClockMessages = 32;
        private const int PingPeriodMs = 1000;
        private static readonly Stopwatch Clock = Stopwatch.StartNew();

        private readonly object _lock = new object();
        private readonly Address _address;
        private readonly Queue<double> _offsetsMs = new Queue<double>();
        private readonly Random _random = new Random();
        private readonly Thread _thread;
        private readonly Drained _drained = new Drained(NowMs);
        private readonly Timer _pings;
        private bool _isPinging;
        private long? _pongNs; // when the answer to the last ping came
        private Subscription _wish;
        private Connection _connection;
        private Hello _hello;
        private Health _health;
        private Estimate _newest;
        private ReflectionMap _reflectionMap;
        private ProbeState _state = ProbeState.Connecting;
        private string _lastError;
        private long _count;
        private int _backoffMs = FirstBackoffMs;

        /// <summary>Starts to connect, and returns at once.</summary>
        /// <param name="address">tcp:HOST:PORT, as lightprobed listens by default: tcp:127.0.0.1:7700; ws://HOST:PORT/; or what
        /// `lightprobe pair` prints.</param>
        /// <param name="wish">What the probe is to send; null: its defaults, and health once a second. It is
        /// not to be changed any more: see <see cref="Subscribe"/>.</param>
        /// <exception cref="ArgumentException">The address is none.</exception>
        public Probe(string address = "tcp:127.0.0.1:7700", Subscription wish = null)
        {
            _address = Address.Parse(address);
            _wish = Numbered(wish ?? new Subscription { HealthPeriodMs = 1000 }, 1);
            _pings = new Timer(_ => Ping());
            _thread = new Thread(Run) { IsBackground = true, Name = "lightprobe " + _address };
            _thread.Start();
            _drained.Start();
        }

        /// <summary>What it is doing.</summary>
        public ProbeState State { get { lock (_lock) return _state; } }

        /// <summary>The greeting of the connection that is open; null: none is.</summary>
        public Hello Hello { get { lock (_lock) return _hello; } }

        /// <summary>The newest report on the probe's health; null before the first.</summary>
        public Health Health { get { lock (_lock) return _health; } }

        /// <summary>Why there is nothing, in a sentence; null while all is well.</summary>
        public string LastError { get { lock (_lock) return _lastError; } }

        /// <summary>
        /// The newest estimate; null before the first, and when it has outlived its TtlMs: then <see cref="Fallback"/> has what to
        /// show. After a pause of the app, what came meanwhile is read first: until then the one before the pause remains.
        /// What was too old when it was sent is so here.
        /// </summary>
        public Estimate Latest
        {
            get
            {
                double untilMs = _drained.UntilMs;
                lock (_lock)
                {
                    if (_newest == null || _newest.TtlMs == 0) return _newest;
                    return Math.Max(AgeMsLocked(untilMs), _newest.SendDelayUs / 1e3) > _newest.TtlMs ? null : _newest;
                }
            }
        }

        /// <summary>Milliseconds since the capture of the newest estimate, aged out or not; null before the first.</summary>
        public double? AgeMs { get { lock (_lock) return _newest == null ? (double?)null : AgeMsLocked(NowMs()); } }

        /// <summary>
        /// The newest reflection map, however old; null before the first. The probe sends some only if the subscription asks for
        /// them and Hello.MaxReflectionMapSize is not 0. <see cref="UnityReflection"/> reads it.
        /// </summary>
        public ReflectionMap ReflectionMap { get { lock (_lock) return _reflectionMap; } }

        /// <summary>Waits for an estimate that comes after this call; null: none came in time.</summary>
        public Estimate WaitForNext(int timeoutMs)
        {
            double until = NowMs() + timeoutMs;
            lock (_lock)
            {
                long before = _count;
                for (double left; _count == before && _state != ProbeState.Closed && (left = until - NowMs()) > 0;)
                    Monitor.Wait(_lock, (int)Math.Ceiling(left));
                return _count == before ? null : _newest;
            }
        }

        /// <summary>Asks for something else, now and after each reconnection. `wish` is not to be changed any more.</summary>
        public void Subscribe(Subscription wish)
        {
            lock (_lock)
            {
                _wish = Numbered(wish, _wish.Number + 1);
                TrySend(Encoded(_wish)); // if it fails, the thread asks for it on the next connection
            }
        }

        /// <summary>Nanoseconds of this client's own steady clock, now: poses have its times.</summary>
        public static long NowNs => (long)(Clock.ElapsedTicks * (1e9 / Stopwatch.Frequency));

        /// <summary>
        /// Says how the head is turned that the probe sits on, and perhaps where it is; false: not connected, or an older probe.
        /// The daemon needs --orientation=client, else it refuses (<see cref="LastError"/>). Subscription.Frame = World then gives
        /// the light in your world. All is right-handed, with +X right, +Y up, −Z forward: from Unity's poses take (−x, −y, z, w)
        /// and (x, y, −z).
        /// </summary>
        /// <param name="xyzw">Unit quaternion that turns the head's frame into your world.</param>
        /// <param name="timeNs">When it was so, of <see cref="NowNs"/>; null: now.</param>
        /// <param name="sigmaDeg">1 sigma about each axis; null: 0.2.</param>
        /// <param name="positionM">x, y, z of the head in that world, in metres: lamps get distances as it moves. Null: not known.</param>
        /// <param name="positionSigmaM">1 sigma along each axis; null: 0.005.</param>
        /// <exception cref="ArgumentException">It is no unit quaternion, no place, or no sigma.</exception>
        public bool SendPose(IReadOnlyList<float> xyzw, long? timeNs = null, float? sigmaDeg = null,
            IReadOnlyList<float> positionM = null, float? positionSigmaM = null)
        {
            byte[] pose = Poses.Pose(xyzw, timeNs ?? NowNs, sigmaDeg, positionM, positionSigmaM);
            lock (_lock)
            {
                if (_hello == null || _hello.ProtocolMinor < MinorWithPings || !TrySend(pose)) return false;
                // From the first pose of a connection on: without poses nobody needs our clock.
                if (!_isPinging) _pings.Change(0, PingPeriodMs);
                _isPinging = true;
                return true;
            }
        }

        private void Ping()
        {
            lock (_lock)
            {
                if (!_isPinging) return;
                TrySend(Poses.Ping(NowNs, _pongNs));
                _pongNs = null;
            }
        }

        private void StopPingsLocked()
        {
            if (_isPinging) _pings.Change(Timeout.Infinite, Timeout.Infinite);
            _isPinging = false;
            _pongNs = null;
        }

        /// <summary>False: there is no connection, or it is broken. The thread notices that, too.</summary>
        private bool TrySend(byte[] message)
        {
            try
            {
                _connection?.Send(message);
                return _connection != null;
            }
            catch (Exception error) when (IsOfConnection(error) || error is TimeoutException)
            {
                return false;
            }
        }

        /// <summary>Ends for good.</summary>
        public void Dispose()
        {
            _drained.Dispose();
            lock (_lock)
            {
                StopPingsLocked();
                _pings.Dispose();
                _state = ProbeState.Closed;
                _connection?.Dispose();
                Monitor.PulseAll(_lock);
            }
        }

        private static double NowMs() => Clock.Elapsed.TotalMilliseconds;

        private double AgeMsLocked(double atMs) => atMs - (_newest.CaptureTimeUnixNs / 1e6 + _offsetsMs.Min());

        private static Subscription Numbered(Subscription wish, uint number)
        {
            wish.Number = number;
            return wish;
        }

        private static bool IsOfConnection(Exception error) =>
            error is IOException || error is SocketException || error is WebSocketException || error is System.Net.WebException
            || error is ObjectDisposedException || error is InvalidOperationException || error is OperationCanceledException;

        // ------------------------------------------------------------ the thread

        private void Run()
        {
            try
            {
                while (State != ProbeState.Closed) RunOnce();
                _drained.Dispose();
            }
            catch (Exception error)
            {
                _drained.Dispose();
                lock (_lock)
                {
                    if (_state == ProbeState.Closed) return; // what reads a connection that was closed under it
                    _lastError = _address + ": client: unexpected " + error + ": please report it";
                    _state = ProbeState.Closed;
                    Monitor.PulseAll(_lock);
                }
            }
        }

        private void RunOnce()
        {
            string why = OneConnection();
            lock (_lock)
            {
                _hello = null;
                _connection = null;
                if (_state != ProbeState.Closed) StopPingsLocked();
                if (_state == ProbeState.Closed) return;
                _lastError = why;
                _state = ProbeState.Waiting;
                Monitor.Wait(_lock, (int)(_backoffMs * (0.8 + 0.4 * _random.NextDouble())));
                _backoffMs = Math.Min(2 * _backoffMs, LastBackoffMs);
                if (_state != ProbeState.Closed) _state = ProbeState.Connecting;
            }
        }

        /// <summary>Gives why it ended; null: for good.</summary>
        private string OneConnection()
        {
            string refusal = null;
            try
            {
                using (Connection connection = Open())
                {
                    for (; ; )
                    {
                        byte[] data = connection.Receive(PatienceMs());
                        if (data == null) return refusal ?? _address + ": the probe closed the connection";
                        FromProbe message = Decode(data);
                        if (Ranges.Broken(message) is string refused) throw new WireException(refused);
                        if (message.Error != null) refusal = Refusal(message.Error);
                        Take(message, refusal);
                        if (State == ProbeState.Closed) return null;
                    }
                }
            }
            catch (WireException error)
            {
                return _address + ": receive: " + error.Message + ": is this a lightprobe?";
            }
            catch (TimeoutException)
            {
                return _address + ": silent for too long: is the network up?";
            }
            catch (Exception error) when (IsOfConnection(error))
            {
                if (refusal != null) return refusal;
                return Hello != null ? _address + ": receive: " + error.Message
                    : _address + ": connect: " + error.Message + ": is lightprobed running, and is this its address?";
            }
        }

        private string Refusal(Error error)
        {
            if (Hello == null && error.Code == TokenRefused) _backoffMs = TokenBackoffMs;
            return _address + ": " + error.Text;
        }

        private Connection Open()
        {
            Connection connection = _address.Open(ConnectMs);
            lock (_lock)
            {
                if (_state == ProbeState.Closed)
                {
                    connection.Dispose();
                    throw new IOException("closed");
                }
                _connection = connection;
                try
                {
                    connection.Send(Encoded(_wish));
                }
                catch
                {
                    connection.Dispose();
                    throw;
                }
            }
            return connection;
        }

        /// <summary>A greeting comes at once, health periodically: longer silence is a fault.</summary>
        private int PatienceMs()
        {
            lock (_lock)
            {
                if (_hello == null) return LeastPatienceMs;
                return _wish.HealthPeriodMs > 0 ? (int)Math.Max(LeastPatienceMs, 5L * _wish.HealthPeriodMs) : Timeout.Infinite;
            }
        }

        internal static FromProbe Decode(byte[] data) => FromProbe.Read(new WireReader(data, 0, data.Length));

        internal static byte[] Encoded(Subscription wish) => new FromClient { Subscribe = wish }.Write(new WireWriter()).ToArray();

        private void Take(FromProbe message, string refusal)
        {
            lock (_lock)
            {
                if (_state == ProbeState.Closed) return;
                if (message.Hello != null) Greet(message.Hello);
                else if (message.Error == null && _hello == null) throw new WireException("the first message is not a Hello");
                if (message.Pong != null) _pongNs = NowNs;
                if (message.Health != null) _health = message.Health;
                if (message.Estimate != null) TakeEstimate(message.Estimate);
                if (message.ReflectionMap != null && message.ReflectionMap.Subscription == _wish.Number) _reflectionMap = message.ReflectionMap;
                if (refusal != null) _lastError = refusal;
            }
        }

        private void Greet(Hello hello)
        {
            if (hello.ProtocolMajor != ProtocolMajor)
            {
                _lastError = _address + ": " + hello.Software + " speaks protocol " + hello.ProtocolMajor + ", this client "
                    + ProtocolMajor + ": use the client of the probe's version";
                _state = ProbeState.Closed;
                _connection?.Dispose();
                Monitor.PulseAll(_lock);
                return;
            }
            _hello = hello;
            _lastError = null;
            _backoffMs = FirstBackoffMs;
            _state = ProbeState.Open;
        }

        private void TakeEstimate(Estimate estimate)
        {
            // What was made for an earlier subscription was on its way.
            if (_hello.ProtocolMinor >= MinorWithNumbers && estimate.Subscription != _wish.Number) return;
            if (_newest == null || _newest.BootId != estimate.BootId) _offsetsMs.Clear();
            _offsetsMs.Enqueue(NowMs() - (estimate.CaptureTimeUnixNs / 1e6 + estimate.SendDelayUs / 1e3));
            if (_offsetsMs.Count > ClockMessages) _offsetsMs.Dequeue();
            _newest = estimate;
            _count++;
            Monitor.PulseAll(_lock);
        }
    }
}
