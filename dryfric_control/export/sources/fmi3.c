/* FMI 3.0 Co-Simulation round the model in model.c. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "model.c"

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the interface says which there are */
#endif

typedef struct {
    model_t model;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance_t;

static fmi3Status failed(const instance_t *instance, const char *why)
{
    if (instance != NULL && instance->log != NULL) {
        instance->log(instance->environment, fmi3Error, "logStatusError", why);
    }
    return fmi3Error;
}

#define FMI(name) fmi3##name
#define HANDLE fmi3Instance
#define STATE(verb, rest) fmi3##verb##FMUState##rest
#define UNPACK fmi3DeserializeFMUState
#include "fmi.c"

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference between[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    instance_t *instance;
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        return NULL;
    }
    instance = calloc(1, sizeof *instance);
    if (instance != NULL) {
        instance->environment = environment;
        instance->log = log;
        model_reset(&instance->model);
    }
    return instance;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean given, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    ((instance_t *)c)->model.start = start;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_read(MODEL(c), vr, n, values));
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                        size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_count(MODEL(c), vr, n, values));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 values[], size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_write(MODEL(c), vr, n, values));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean final,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    model_t *model = MODEL(c);
    const char *why = model_step(model, time, step);
    *events = false;
    *terminate = false;
    *early = false;
    *last = model->time;
    return told(c, why);
}

/* What a model of this kind does not have: every importer asks for these names. */

#define VR const fmi3ValueReference vr[], size_t n
#define ABSENT(Name, ...) \
    fmi3Status fmi3##Name(__VA_ARGS__) { return failed(c, #Name " has nothing to act on"); }
#define NO_GET(Type) ABSENT(Get##Type, fmi3Instance c, VR, fmi3##Type values[], size_t m)
#define NO_SET(Type) ABSENT(Set##Type, fmi3Instance c, VR, const fmi3##Type values[], size_t m)
#define NEITHER(Type) NO_GET(Type) NO_SET(Type)

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    return NULL;
}

NEITHER(Float32)
NEITHER(Int8)
NEITHER(UInt8)
NEITHER(Int16)
NEITHER(UInt16)
NO_SET(Int32)
NEITHER(UInt32)
NEITHER(Int64)
NEITHER(UInt64)
NEITHER(Boolean)
NEITHER(String)
ABSENT(GetBinary, fmi3Instance c, VR, size_t sizes[], fmi3Binary values[], size_t m)
ABSENT(SetBinary, fmi3Instance c, VR, const size_t sizes[], const fmi3Binary values[], size_t m)
ABSENT(GetClock, fmi3Instance c, VR, fmi3Clock values[])
ABSENT(SetClock, fmi3Instance c, VR, const fmi3Clock values[])
ABSENT(EnterEventMode, fmi3Instance c)
ABSENT(EnterConfigurationMode, fmi3Instance c)
ABSENT(ExitConfigurationMode, fmi3Instance c)
ABSENT(EvaluateDiscreteStates, fmi3Instance c)
ABSENT(EnterContinuousTimeMode, fmi3Instance c)
ABSENT(GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n)
ABSENT(GetVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t at[], fmi3ValueReference on[],
       size_t from[], fmi3DependencyKind kinds[], size_t n)
ABSENT(GetDirectionalDerivative, fmi3Instance c, VR, const fmi3ValueReference on[], size_t m,
       const fmi3Float64 seed[], size_t ns, fmi3Float64 values[], size_t nv)
ABSENT(GetAdjointDerivative, fmi3Instance c, VR, const fmi3ValueReference on[], size_t m,
       const fmi3Float64 seed[], size_t ns, fmi3Float64 values[], size_t nv)
ABSENT(GetOutputDerivatives, fmi3Instance c, VR, const fmi3Int32 orders[], fmi3Float64 values[], size_t m)
ABSENT(GetIntervalDecimal, fmi3Instance c, VR, fmi3Float64 intervals[], fmi3IntervalQualifier kinds[])
ABSENT(GetIntervalFraction, fmi3Instance c, VR, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
       fmi3IntervalQualifier kinds[])
ABSENT(GetShiftDecimal, fmi3Instance c, VR, fmi3Float64 shifts[])
ABSENT(GetShiftFraction, fmi3Instance c, VR, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
ABSENT(SetIntervalDecimal, fmi3Instance c, VR, const fmi3Float64 intervals[])
ABSENT(SetIntervalFraction, fmi3Instance c, VR, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
ABSENT(SetShiftDecimal, fmi3Instance c, VR, const fmi3Float64 shifts[])
ABSENT(SetShiftFraction, fmi3Instance c, VR, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
ABSENT(UpdateDiscreteStates, fmi3Instance c, fmi3Boolean *more, fmi3Boolean *terminate, fmi3Boolean *nominals,
       fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
ABSENT(CompletedIntegratorStep, fmi3Instance c, fmi3Boolean kept, fmi3Boolean *event, fmi3Boolean *terminate)
ABSENT(SetTime, fmi3Instance c, fmi3Float64 time)
ABSENT(SetContinuousStates, fmi3Instance c, const fmi3Float64 states[], size_t n)
ABSENT(GetContinuousStateDerivatives, fmi3Instance c, fmi3Float64 values[], size_t n)
ABSENT(GetEventIndicators, fmi3Instance c, fmi3Float64 values[], size_t n)
ABSENT(GetContinuousStates, fmi3Instance c, fmi3Float64 states[], size_t n)
ABSENT(GetNominalsOfContinuousStates, fmi3Instance c, fmi3Float64 values[], size_t n)
ABSENT(GetNumberOfEventIndicators, fmi3Instance c, size_t *n)
ABSENT(GetNumberOfContinuousStates, fmi3Instance c, size_t *n)
ABSENT(ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
