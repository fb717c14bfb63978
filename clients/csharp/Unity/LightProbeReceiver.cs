// SPDX-License-Identifier: Apache-2.0
using System.Collections.Generic;
using Lightprobe.Messages;
using UnityEngine;
using UnityEngine.Rendering;

namespace Lightprobe
{
    /// <summary>
    /// Lights the scene with a probe's light: lamps become directional lights below this object, the rest the ambient probe;
    /// in HDRP lamps alone, because HDRP takes ambient light from its sky and overwrites what others set (its
    /// SkyManager.SetupAmbientProbe). The probe's axes are those of this object's transform. Lamps fade in and out; they do not
    /// pop.
    /// </summary>
    [AddComponentMenu("Lighting/Lightprobe receiver")]
    public sealed class LightProbeReceiver : MonoBehaviour
    {
        private const string LampsAlone =
            "lightprobe: HDRP takes ambient light from its sky: only lamps come from the probe. Give the scene a sky as bright as the room.";

        [Tooltip("tcp:HOST:PORT of the probe")]
        [SerializeField] private string address = "tcp:127.0.0.1:7700";
        [Tooltip("Lamps at once")]
        [Range(0, 8)]
        [SerializeField] private int lamps = 4;
        [Tooltip("Built-in and URP, or HDRP: they differ in what intensity means; in HDRP only lamps come from the probe")]
        [SerializeField] private Pipeline pipeline = Pipeline.Universal;
        [Tooltip("Time constant of changes, in seconds")]
        [SerializeField] private float fadeS = 0.15f;

        /// <summary>After a pause of the app a fade goes on from where it was: one step is never longer.</summary>
        private const float MostStepS = 0.1f;

        private readonly Dictionary<uint, LampFade> _shown = new Dictionary<uint, LampFade>();
        private readonly List<uint> _gone = new List<uint>();
        private float[,] _ambient = new float[3, 9];
        private bool _hasAmbient;
        private uint _bootId;
        private Probe _probe;
        private Estimate _last, _fallback;

        /// <summary>The client; null while the component is off.</summary>
        public Probe Probe => _probe;

        /// <summary>How it is, in a sentence, for your interface.</summary>
        public string Status =>
            _probe == null ? "off" : _probe.LastError ?? (_probe.Latest == null ? Waiting : "light is " + _probe.AgeMs.Value.ToString("0") + " ms old");

        private string Waiting =>
            _probe.Hello == null ? "connecting to " + address : "connected, waiting for light; the probe's camera: "
                + (_probe.Health == null ? "not known yet" : _probe.Health.SourceState.ToString());

        private void OnEnable()
        {
            if (pipeline == Pipeline.HighDefinition) Debug.LogWarning(LampsAlone, this);
            else GraphicsSettings.lightsUseLinearIntensity = true; // else the built-in pipeline takes intensity as sRGB
            _probe = new Probe(address, new Subscription { MaxLights = (uint)lamps, HealthPeriodMs = 1000 });
        }

        private void OnDisable()
        {
            _probe?.Dispose();
            _probe = null;
        }

        private void Update()
        {
            Estimate estimate = _probe?.Latest;
            float share = 1 - Mathf.Exp(-Mathf.Min(Time.deltaTime, MostStepS) / Mathf.Max(fadeS, 1e-3f));
            if (estimate != null && estimate.BootId != _bootId) Restarted(estimate.BootId);
            foreach (LampFade lamp in _shown.Values) lamp.Goal = 0;
            if (estimate != null)
                foreach (var lamp in estimate.Lights) Aim(lamp, estimate.CdM2PerUnit ?? 1);
            Fade(share);
            if (pipeline == Pipeline.Universal) Ambient(estimate ?? Without(), share);
            if (estimate == null) return;
            _last = estimate;
            _fallback = null;
        }

        /// <summary>What to show before the first and after the last estimate.</summary>
        private Estimate Without() => _fallback = _fallback ?? Fallback.Estimate(_last);

        /// <summary>Numbers of lamps begin anew: the lamps of before fade out beside the new ones.</summary>
        private void Restarted(uint bootId)
        {
            var before = new List<LampFade>(_shown.Values);
            _shown.Clear();
            for (int i = 0; i < before.Count; i++) _shown[uint.MaxValue - (uint)i] = before[i];
            _bootId = bootId;
        }

        private void Aim(Messages.Light lamp, float cdM2PerUnit)
        {
            var light = new UnityLight(lamp, pipeline, cdM2PerUnit);
            if (!_shown.TryGetValue(lamp.Id, out LampFade shown)) _shown[lamp.Id] = shown = new LampFade(transform);
            shown.Aim(light);
        }

        private void Fade(float share)
        {
            _gone.Clear();
            foreach (KeyValuePair<uint, LampFade> one in _shown)
                if (!one.Value.Step(share)) _gone.Add(one.Key);
            foreach (uint id in _gone) _shown.Remove(id);
        }

        private void Ambient(Estimate estimate, float share)
        {
            float[,] goal = estimate.Sh == null ? new float[3, 9] : UnityLight.SphericalHarmonicsL2(estimate.Sh);
            if (!_hasAmbient) share = 1; // nothing was shown that it could fade from
            _hasAmbient = true;
            var probe = new SphericalHarmonicsL2();
            for (int c = 0; c < 3; c++)
                for (int i = 0; i < 9; i++)
                    probe[c, i] = _ambient[c, i] += share * (goal[c, i] - _ambient[c, i]);
            RenderSettings.ambientMode = AmbientMode.Custom;
            RenderSettings.ambientProbe = probe;
        }
    }
}
