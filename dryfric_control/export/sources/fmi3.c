/* FMI 3.0 Co-Simulation round the model in model.c. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "model.c"

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

static fmi3Status told(const instance_t *instance, const char *why)
{
    return why == NULL ? fmi3OK : failed(instance, why);
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference between[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    instance_t *instance;
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early; (void)between;
    (void)n; (void)update;
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

void fmi3FreeInstance(fmi3Instance c)
{
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean given, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    (void)given; (void)tolerance; (void)ends; (void)stop;
    ((instance_t *)c)->model.start = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    model_start(&((instance_t *)c)->model);
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    (void)c;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    (void)c;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    model_reset(&((instance_t *)c)->model);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_read(&((instance_t *)c)->model, vr, n, values));
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                        size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_count(&((instance_t *)c)->model, vr, n, values));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 values[], size_t nvalues)
{
    return told(c, n != nvalues ? "every variable is one number"
                                : model_write(&((instance_t *)c)->model, vr, n, values));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean final,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    model_t *model = &((instance_t *)c)->model;
    const char *why = model_step(model, time, step);
    (void)final;
    *events = false;
    *terminate = false;
    *early = false;
    *last = model->time;
    return told(c, why);
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    return told(c, model_keep(state, &((instance_t *)c)->model));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    memcpy(&((instance_t *)c)->model, state, sizeof(model_t));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(model_t);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return told(c, model_pack(state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return told(c, model_unpack(state, bytes, size));
}

/* What a model of this kind does not have: every importer asks for these names. */

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
    fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment
    instanceEnvironment, fmi3LogMessageCallback logMessage)
{
    (void)instanceName; (void)instantiationToken; (void)resourcePath; (void)visible;
    (void)loggingOn; (void)instanceEnvironment; (void)logMessage;
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String
    instantiationToken, fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
    fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName; (void)instantiationToken; (void)resourcePath; (void)visible;
    (void)loggingOn; (void)instanceEnvironment; (void)logMessage; (void)clockUpdate;
    (void)lockPreemption; (void)unlockPreemption;
    return NULL;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    (void)instance;
    return failed(instance, "EnterEventMode has nothing to act on");
}

fmi3Status fmi3GetFloat32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Float32 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetFloat32 has nothing to act on");
}

fmi3Status fmi3GetInt8(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Int8 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetInt8 has nothing to act on");
}

fmi3Status fmi3GetUInt8(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3UInt8 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetUInt8 has nothing to act on");
}

fmi3Status fmi3GetInt16(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Int16 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetInt16 has nothing to act on");
}

fmi3Status fmi3GetUInt16(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3UInt16 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetUInt16 has nothing to act on");
}

fmi3Status fmi3GetUInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3UInt32 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetUInt32 has nothing to act on");
}

fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Int64 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetInt64 has nothing to act on");
}

fmi3Status fmi3GetUInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3UInt64 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetUInt64 has nothing to act on");
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Boolean values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetBoolean has nothing to act on");
}

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3String values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "GetString has nothing to act on");
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, size_t valueSizes[], fmi3Binary values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)valueSizes;
    (void)values; (void)nValues;
    return failed(instance, "GetBinary has nothing to act on");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, fmi3Clock values[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values;
    return failed(instance, "GetClock has nothing to act on");
}

fmi3Status fmi3SetFloat32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Float32 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetFloat32 has nothing to act on");
}

fmi3Status fmi3SetInt8(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Int8 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetInt8 has nothing to act on");
}

fmi3Status fmi3SetUInt8(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3UInt8 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetUInt8 has nothing to act on");
}

fmi3Status fmi3SetInt16(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Int16 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetInt16 has nothing to act on");
}

fmi3Status fmi3SetUInt16(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3UInt16 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetUInt16 has nothing to act on");
}

fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Int32 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetInt32 has nothing to act on");
}

fmi3Status fmi3SetUInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3UInt32 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetUInt32 has nothing to act on");
}

fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Int64 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetInt64 has nothing to act on");
}

fmi3Status fmi3SetUInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3UInt64 values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetUInt64 has nothing to act on");
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Boolean values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetBoolean has nothing to act on");
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3String values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values; (void)nValues;
    return failed(instance, "SetString has nothing to act on");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)valueSizes;
    (void)values; (void)nValues;
    return failed(instance, "SetBinary has nothing to act on");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t
    nValueReferences, const fmi3Clock values[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)values;
    return failed(instance, "SetClock has nothing to act on");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference
    valueReference, size_t* nDependencies)
{
    (void)instance; (void)valueReference; (void)nDependencies;
    return failed(instance, "GetNumberOfVariableDependencies has nothing to act on");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t
    elementIndicesOfDependent[], fmi3ValueReference independents[], size_t
    elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    (void)instance; (void)dependent; (void)elementIndicesOfDependent; (void)independents;
    (void)elementIndicesOfIndependents; (void)dependencyKinds; (void)nDependencies;
    return failed(instance, "GetVariableDependencies has nothing to act on");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
    size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)instance; (void)unknowns; (void)nUnknowns; (void)knowns; (void)nKnowns; (void)seed;
    (void)nSeed; (void)sensitivity; (void)nSensitivity;
    return failed(instance, "GetDirectionalDerivative has nothing to act on");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
    size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)instance; (void)unknowns; (void)nUnknowns; (void)knowns; (void)nKnowns; (void)seed;
    (void)nSeed; (void)sensitivity; (void)nSensitivity;
    return failed(instance, "GetAdjointDerivative has nothing to act on");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    (void)instance;
    return failed(instance, "EnterConfigurationMode has nothing to act on");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    (void)instance;
    return failed(instance, "ExitConfigurationMode has nothing to act on");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)intervals;
    (void)qualifiers;
    return failed(instance, "GetIntervalDecimal has nothing to act on");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference
    valueReferences[], size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
    fmi3IntervalQualifier qualifiers[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)counters;
    (void)resolutions; (void)qualifiers;
    return failed(instance, "GetIntervalFraction has nothing to act on");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, fmi3Float64 shifts[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)shifts;
    return failed(instance, "GetShiftDecimal has nothing to act on");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)counters;
    (void)resolutions;
    return failed(instance, "GetShiftFraction has nothing to act on");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, const fmi3Float64 intervals[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)intervals;
    return failed(instance, "SetIntervalDecimal has nothing to act on");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference
    valueReferences[], size_t nValueReferences, const fmi3UInt64 counters[], const fmi3UInt64
    resolutions[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)counters;
    (void)resolutions;
    return failed(instance, "SetIntervalFraction has nothing to act on");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, const fmi3Float64 shifts[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)shifts;
    return failed(instance, "SetShiftDecimal has nothing to act on");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
    size_t nValueReferences, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)counters;
    (void)resolutions;
    return failed(instance, "SetShiftFraction has nothing to act on");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    (void)instance;
    return failed(instance, "EvaluateDiscreteStates has nothing to act on");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* discreteStatesNeedUpdate,
    fmi3Boolean* terminateSimulation, fmi3Boolean* nominalsOfContinuousStatesChanged, fmi3Boolean*
    valuesOfContinuousStatesChanged, fmi3Boolean* nextEventTimeDefined, fmi3Float64* nextEventTime)
{
    (void)instance; (void)discreteStatesNeedUpdate; (void)terminateSimulation;
    (void)nominalsOfContinuousStatesChanged; (void)valuesOfContinuousStatesChanged;
    (void)nextEventTimeDefined; (void)nextEventTime;
    return failed(instance, "UpdateDiscreteStates has nothing to act on");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    (void)instance;
    return failed(instance, "EnterContinuousTimeMode has nothing to act on");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean
    noSetFMUStatePriorToCurrentPoint, fmi3Boolean* enterEventMode, fmi3Boolean* terminateSimulation)
{
    (void)instance; (void)noSetFMUStatePriorToCurrentPoint; (void)enterEventMode;
    (void)terminateSimulation;
    return failed(instance, "CompletedIntegratorStep has nothing to act on");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    (void)instance; (void)time;
    return failed(instance, "SetTime has nothing to act on");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
    size_t nContinuousStates)
{
    (void)instance; (void)continuousStates; (void)nContinuousStates;
    return failed(instance, "SetContinuousStates has nothing to act on");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
    size_t nContinuousStates)
{
    (void)instance; (void)derivatives; (void)nContinuousStates;
    return failed(instance, "GetContinuousStateDerivatives has nothing to act on");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t
    nEventIndicators)
{
    (void)instance; (void)eventIndicators; (void)nEventIndicators;
    return failed(instance, "GetEventIndicators has nothing to act on");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t
    nContinuousStates)
{
    (void)instance; (void)continuousStates; (void)nContinuousStates;
    return failed(instance, "GetContinuousStates has nothing to act on");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t
    nContinuousStates)
{
    (void)instance; (void)nominals; (void)nContinuousStates;
    return failed(instance, "GetNominalsOfContinuousStates has nothing to act on");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t* nEventIndicators)
{
    (void)instance; (void)nEventIndicators;
    return failed(instance, "GetNumberOfEventIndicators has nothing to act on");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t* nContinuousStates)
{
    (void)instance; (void)nContinuousStates;
    return failed(instance, "GetNumberOfContinuousStates has nothing to act on");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference
    valueReferences[], size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
    size_t nValues)
{
    (void)instance; (void)valueReferences; (void)nValueReferences; (void)orders; (void)values;
    (void)nValues;
    return failed(instance, "GetOutputDerivatives has nothing to act on");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
    fmi3Float64 activationTime)
{
    (void)instance; (void)clockReference; (void)activationTime;
    return failed(instance, "ActivateModelPartition has nothing to act on");
}
