-- A thermosalinograph on a serial port of the autopilot. Its lines, 9600 baud:
--
--   t1= 23.7658, c1= 0.00019, s1= 0.0084
--
-- become NAMED_VALUE_FLOAT "TEMP" and "SALT". ArduPilot 4.5 or later, with SCR_ENABLE 1 and SERIALx_PROTOCOL 28 for the
-- port; this file is APM/scripts/thermosalinograph.lua on the SD card. With a DELAY_MS the service needs
-- sensor.clock: vehicle.

local DELAY_MS = 10000  -- the hose's volume over the flow, plus the time constant of the sensor
local FLUSH_MS = 14000  -- nothing is sent so long after the pump began to run
local WARM_UP_MS = 30000  -- nor so long after the first line, and after a silence
local SILENCE_MS = 10000
local PUMP_RELAY = 0  -- the relay that switches the pump (RELAY1_... is 0); nil: it always runs

-- All of a line must match: four decimals, or it is a part of a number.
local PATTERN = "^t1=%s*(%-?%d+%.%d%d%d%d),%s*c1=%s*%-?%d+%.%d+,%s*s1=%s*(%-?%d+%.%d%d%d%d)$"

local LONGEST_LINE = 80
local MOST_BYTES = 512  -- at once: a script must not take long
local NAMED_VALUE_FLOAT = 251
local CHANNELS = 5
local WARNING, INFO = 4, 6

local port = assert(serial:find_serial(0), "thermosalinograph.lua: no serial port with protocol 28")
port:begin(9600)
port:set_flow_control(0)

local line, skipping = "", true  -- what comes first may be the rest of a line
local heard_ms, warm_ms, flushed_ms = nil, nil, nil
local told = nil
local unreadable = 0

local function tell(text, severity)
  if text ~= told then
    told = text
    gcs:send_text(severity, "thermosalinograph: " .. text)
  end
end

-- NAMED_VALUE_FLOAT with the time at which the water was taken in. gcs:send_named_float has only the present time.
local function send(name, value)
  if DELAY_MS == 0 then
    gcs:send_named_float(name, value)
    return
  end
  local padded = name .. string.rep("\0", 10 - #name)
  local payload = string.pack("<i4fc10", (millis() - DELAY_MS):toint(), value, padded)
  for channel = 0, CHANNELS - 1 do
    mavlink:send_chan(channel, NAMED_VALUE_FLOAT, payload)  -- nothing on channels that there are not
  end
end

-- Milliseconds since a time, or nil.
local function since(time_ms)
  return time_ms and (millis() - time_ms):toint()
end

-- Why values are not of the sea just now, or nil.
local function withheld()
  if heard_ms == nil or since(heard_ms) > SILENCE_MS then
    warm_ms = millis()
  end
  heard_ms = millis()
  if PUMP_RELAY then
    if relay:get(PUMP_RELAY) ~= 1 then
      flushed_ms = nil
      return "the pump is off"
    end
    flushed_ms = flushed_ms or millis()
  end
  if since(warm_ms) < WARM_UP_MS then
    return "warming up"
  end
  if PUMP_RELAY and since(flushed_ms) < FLUSH_MS then
    return "the hose is being flushed"
  end
  return nil
end

local function take(text)
  local temperature, salinity = text:match(PATTERN)
  if not salinity then
    unreadable = unreadable + 1
    if unreadable % 100 == 1 then
      gcs:send_text(WARNING, "thermosalinograph: can't read " .. text:sub(1, 24))
    end
    return
  end
  local reason = withheld()
  tell(reason or "sending", reason == "the pump is off" and WARNING or INFO)
  if not reason then
    send("TEMP", tonumber(temperature))
    send("SALT", tonumber(salinity))
  end
end

local function add(byte)
  if byte == 10 or byte == 13 then
    if not skipping and #line > 0 then
      take(line)
    end
    line, skipping = "", false
  elseif #line >= LONGEST_LINE then
    line, skipping = "", true
  elseif not skipping then
    line = line .. string.char(byte)
  end
end

local function update()
  for _ = 1, math.min(port:available():toint(), MOST_BYTES) do
    add(port:read())
  end
  local silent_ms = since(heard_ms)
  if silent_ms and silent_ms > SILENCE_MS then
    tell("the instrument is silent", WARNING)
  end
  return update, 50
end

return update, 1000
