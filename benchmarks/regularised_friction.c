/* A mass pulled through a spring whose end moves at constant velocity, with regularised friction, as
 * an FMU 2.0 for model exchange.  Friction is a straight line through zero within +-linear, as in
 * Modelica.Electrical.Machines.Losses.Friction, and beyond it the level of the Stribeck curve.
 * Built by peers.regularised_fmu; states x, v; a variable's reference is its place in `value`. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { X, V, DX, DV, MASS, STIFFNESS, BELT, COULOMB, EXCESS, STRIBECK, STICK, LINEAR, COUNT };

typedef struct {
    double time;
    double value[COUNT];
} model;

static void rates(model *m)
{
    double *p = m->value, v = p[V];
    double fast = fabs(v) > p[LINEAR] ? fabs(v) : p[LINEAR];
    double q = (fast - p[STICK]) / p[STRIBECK];
    double level = p[COULOMB] * (1.0 + p[EXCESS] * exp(-q * q));
    double friction = level * (fast > p[LINEAR] ? copysign(1.0, v) : v / p[LINEAR]);
    p[DX] = v;
    p[DV] = (p[STIFFNESS] * (p[BELT] * m->time - p[X]) - friction) / p[MASS];
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    (void)name, (void)guid, (void)place, (void)callbacks, (void)visible, (void)logging;
    return type == fmi2ModelExchange ? calloc(1, sizeof(model)) : NULL;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real out[])
{
    rates(c);
    for (size_t i = 0; i < n; i++) out[i] = ((model *)c)->value[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real in[])
{
    for (size_t i = 0; i < n; i++) ((model *)c)->value[vr[i]] = in[i];
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((model *)c)->time = time;
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    memcpy(x, ((model *)c)->value, n * sizeof *x);
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    memcpy(((model *)c)->value, x, n * sizeof *x);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    rates(c);
    memcpy(dx, ((model *)c)->value + DX, n * sizeof *dx);
    return fmi2OK;
}

/* Absolute tolerances are the relative one times these, as for the other peers. */
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    (void)c;
    for (size_t i = 0; i < n; i++) nominal[i] = 1e-4;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean keep, fmi2Boolean *event,
                                       fmi2Boolean *end)
{
    (void)c, (void)keep;
    *event = *end = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    (void)tolerant, (void)tolerance, (void)ends, (void)stop;
    return fmi2SetTime(c, start);
}

/* Nothing to do: no modes, no events, no inputs. */
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }
fmi2Status fmi2EnterEventMode(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }
fmi2Status fmi2Reset(fmi2Component c) { return c ? fmi2OK : fmi2Fatal; }

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    (void)c, (void)z, (void)n;
    return fmi2OK;
}

/* What the interface lists and this model does not have. */
#define NONE(name, ...) \
    fmi2Status name(fmi2Component c, __VA_ARGS__) { return c ? fmi2Error : fmi2Fatal; }
typedef const fmi2ValueReference *refs;

NONE(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String what[])
NONE(fmi2GetInteger, refs vr, size_t n, fmi2Integer out[])
NONE(fmi2SetInteger, refs vr, size_t n, const fmi2Integer in[])
NONE(fmi2GetBoolean, refs vr, size_t n, fmi2Boolean out[])
NONE(fmi2SetBoolean, refs vr, size_t n, const fmi2Boolean in[])
NONE(fmi2GetString, refs vr, size_t n, fmi2String out[])
NONE(fmi2SetString, refs vr, size_t n, const fmi2String in[])
NONE(fmi2GetFMUstate, fmi2FMUstate *state)
NONE(fmi2SetFMUstate, fmi2FMUstate state)
NONE(fmi2FreeFMUstate, fmi2FMUstate *state)
NONE(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
NONE(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte out[], size_t size)
NONE(fmi2DeSerializeFMUstate, const fmi2Byte in[], size_t size, fmi2FMUstate *state)
NONE(fmi2GetDirectionalDerivative, refs unknown, size_t m, refs known, size_t n,
     const fmi2Real dv[], fmi2Real out[])
