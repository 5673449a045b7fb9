"""The rules of Google's Gemini API.

Fields: https://ai.google.dev/api/generate-content and https://ai.google.dev/api/caching#Tool.
Function calling (names only with mode ANY or VALIDATED):
https://ai.google.dev/gemini-api/docs/function-calling. Thinking (a level for Gemini 3, a budget for
2.5, never both): https://ai.google.dev/gemini-api/docs/thinking. Signatures of thoughts that must
come back with a call: https://ai.google.dev/gemini-api/docs/thought-signatures. Pictures:
https://ai.google.dev/gemini-api/docs/image-understanding. Cache:
https://ai.google.dev/gemini-api/docs/caching. Errors:
https://ai.google.dev/gemini-api/docs/troubleshooting and https://google.aip.dev/193.
"""

import re
from dataclasses import dataclass

from loopback import Fields, Received
from strict import Asked, Refused, Said, Usage, common, header, picture, written

TOP = frozenset(
    {
        "contents",
        "tools",
        "toolConfig",
        "safetySettings",
        "systemInstruction",
        "generationConfig",
        "cachedContent",
        "serviceTier",
        "store",
    }
)
CONFIG = frozenset(
    {
        "stopSequences",
        "responseMimeType",
        "responseSchema",
        "responseJsonSchema",
        "responseModalities",
        "candidateCount",
        "maxOutputTokens",
        "temperature",
        "topP",
        "topK",
        "seed",
        "presencePenalty",
        "frequencyPenalty",
        "responseLogprobs",
        "logprobs",
        "thinkingConfig",
        "mediaResolution",
        "enableEnhancedCivicAnswers",
        "speechConfig",
        "imageConfig",
    }
)
PART = frozenset(
    {
        "text",
        "thought",
        "thoughtSignature",
        "inlineData",
        "functionCall",
        "functionResponse",
        "fileData",
        "mediaResolution",
        "videoMetadata",
    }
)
PICTURES = ("image/png", "image/jpeg", "image/webp", "image/heic", "image/heif")
NAME = re.compile(r"[a-zA-Z_][a-zA-Z0-9_.:-]{0,127}")
STATES = {
    400: "INVALID_ARGUMENT",
    401: "UNAUTHENTICATED",
    403: "PERMISSION_DENIED",
    404: "NOT_FOUND",
    413: "INVALID_ARGUMENT",
    429: "RESOURCE_EXHAUSTED",
    500: "INTERNAL",
    529: "UNAVAILABLE",
}
SIGNS = ("gemini-3", "gemini-4")  # each first call of a turn
LEAST = {"gemini-2.5": 2048}  # tokens; else 4,096


def bad(message: str) -> Refused:
    return Refused(400, message)


def camel(name: str) -> str:
    """A field's name as it is documented; the other spelling is taken as well, as of any message:
    https://protobuf.dev/programming-guides/json/."""
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)


def unknown_in(body: Fields, names: frozenset[str], where: str = "") -> None:
    if (name := next((name for name in body if camel(name) not in names), None)) is not None:
        place = f' at "{where}"' if where else ""
        raise bad(
            f'Invalid JSON payload received. Unknown name "{name}"{place}: Cannot find field.'
        )


@dataclass
class Gemini:
    """The Gemini API's `generateContent`."""

    variable: str = "GOOGLE_GEMINI_BASE_URL"
    suffix: str = ""

    def read(self, received: Received) -> Asked:
        body = received.body
        path = re.fullmatch(r"/v1beta/models/([\w.-]+):generateContent", received.path)
        if path is None:
            raise Refused(404, "Requested entity was not found.")
        model = path[1]
        if not header(received, "x-goog-api-key").startswith("k-"):
            raise bad("API key not valid. Please pass a valid API key.")
        unknown_in(body, TOP)
        config = body.get("generationConfig", {})
        unknown_in(config, CONFIG, "generation_config")
        if not 0 <= config.get("temperature", 1) <= 2:
            raise bad("Invalid value at 'generation_config.temperature'")
        effort = self.thinking(config.get("thinkingConfig", {}), model)
        tools = tuple(self.tool(d) for t in body.get("tools", ()) for d in self.declared(t))
        if tools and config.get("responseMimeType") == "application/json":
            raise bad("Function calling with a response mime type: 'application/json' is"
                      " unsupported")  # fmt: skip
        text, pictures = self.contents(body["contents"], model)
        prefix = written([body.get("systemInstruction"), body.get("tools"), body["contents"]])
        return Asked(
            tools=tools,
            choice=self.choice(body, tools),
            pictures=pictures,
            text=text,
            prefix=prefix,
            model=model,
            effort=effort,
        )

    def thinking(self, told: Fields, model: str) -> str:
        unknown_in(
            told,
            frozenset({"includeThoughts", "thinkingBudget", "thinkingLevel"}),
            "generation_config.thinking_config",
        )
        told = {camel(name): value for name, value in told.items()}
        if told and model.startswith(("gemini-1", "gemini-2.0")):
            raise bad("Thinking is not enabled for this model.")
        if {"thinkingBudget", "thinkingLevel"} <= set(told):
            raise bad("You can only set only one of thinking budget and thinking level.")
        if "thinkingLevel" in told:
            if model.startswith("gemini-2"):
                raise bad("Thinking level is not supported for this model.")
            if told["thinkingLevel"].upper() not in ("MINIMAL", "LOW", "MEDIUM", "HIGH"):
                raise bad("Invalid value at 'generation_config.thinking_config.thinking_level'")
        if not -1 <= told.get("thinkingBudget", -1) <= 24_576:
            raise bad("The thinking budget is invalid. Please choose a value between 1 and 24576.")
        return str(told.get("thinkingLevel", told.get("thinkingBudget", "")))

    def declared(self, tool: Fields) -> list[Fields]:
        unknown_in(tool, frozenset({"functionDeclarations"}), "tools[0]")
        return list(tool["functionDeclarations"])

    def tool(self, told: Fields) -> str:
        names = {"name", "description", "parameters", "parametersJsonSchema", "behavior"}
        unknown_in(told, frozenset(names), "tools[0].function_declarations[0]")
        if {"parameters", "parametersJsonSchema"} <= set(map(camel, told)):
            raise bad("parameters and parameters_json_schema are mutually exclusive.")
        if not NAME.fullmatch(told["name"]):
            raise bad("Invalid function name. Must start with a letter or an underscore.")
        return str(told["name"])

    def choice(self, body: Fields, tools: tuple[str, ...]) -> str | None:
        if "toolConfig" not in body:
            return None
        unknown_in(
            body["toolConfig"],
            frozenset({"functionCallingConfig", "retrievalConfig"}),
            "tool_config",
        )
        calling = body["toolConfig"].get("functionCallingConfig", {})
        if calling and not tools:
            raise bad("Function calling config is set without function_declarations.")
        mode, names = calling.get("mode", "AUTO"), calling.get("allowedFunctionNames", [])
        if mode not in ("AUTO", "ANY", "NONE", "VALIDATED"):
            raise bad("Invalid value at 'tool_config.function_calling_config.mode'")
        if names and mode not in ("ANY", "VALIDATED"):
            raise bad("Allowed function names should be set only when function calling mode is ANY"
                      " or VALIDATED.")  # fmt: skip
        if set(names) - set(tools):
            raise bad("Allowed function names must be declared.")
        open_to = names or list(tools)
        return str(open_to[0]) if mode == "ANY" and len(open_to) == 1 else None

    def contents(self, contents: list[Fields], model: str) -> tuple[str, tuple[bytes, ...]]:
        words: list[str] = []
        pictures: list[bytes] = []
        calls = 0
        if not contents:
            raise bad("GenerateContentRequest.contents: contents is not specified")
        for n, content in enumerate(contents):
            if content.get("role") not in ("user", "model"):
                raise bad("Please use a valid role: user, model.")
            if not content.get("parts"):
                raise bad(f"contents.parts must not be empty at contents[{n}]")
            results = sum("functionResponse" in part for part in content["parts"])
            if results != calls:
                raise bad("Please ensure that the number of function response parts is equal to the"
                          " number of function call parts of the function call turn.")  # fmt: skip
            called = [part for part in content["parts"] if "functionCall" in part]
            calls = len(called)
            if called and model.startswith(SIGNS) and "thoughtSignature" not in called[0]:
                raise bad("Function call is missing a thought_signature in functionCall parts.")
            for part in content["parts"]:
                unknown_in(part, PART, f"contents[{n}].parts[0]")
                if "inlineData" in part:
                    pictures.append(self.inline(part["inlineData"]))
                elif "text" in part and content["role"] == "user":
                    words.append(part["text"])
        return "\n".join(words), tuple(pictures)

    def inline(self, data: Fields) -> bytes:
        unknown_in(data, frozenset({"mimeType", "data"}), "contents[0].parts[0].inline_data")
        data = {camel(name): value for name, value in data.items()}
        standard = data["data"].replace("-", "+").replace("_", "/")
        try:
            return picture(standard, data["mimeType"], kinds=PICTURES, most=20_000_000)
        except ValueError as error:
            raise bad("Unable to process input image.") from error

    def cached(self, asked: Asked, earlier: list[Asked]) -> Usage:
        least = next((n for name, n in LEAST.items() if asked.model.startswith(name)), 4096)
        return common(asked, earlier, least=least)

    def reply(self, asked: Asked, said: Said, usage: Usage) -> Fields:
        parts: list[Fields] = []
        if said.thoughts:
            parts.append({"text": said.thoughts, "thought": True})
        if said.words and said.end != "refusal":
            parts.append({"text": said.words})
        if said.tool:
            call: Fields = {"functionCall": {"name": said.tool, "args": said.fields}}
            if asked.model.startswith(SIGNS):
                call["thoughtSignature"] = "c2ln"
            parts.append(call)
        finish = {"done": "STOP", "length": "MAX_TOKENS", "refusal": "SAFETY"}[said.end]
        candidate: Fields = {"finishReason": finish, "index": 0}
        if said.end == "refusal":
            candidate["finishMessage"] = said.words
        else:
            candidate["content"] = {"role": "model", "parts": parts}
        counts = {
            "promptTokenCount": usage.sent,
            "candidatesTokenCount": usage.received,
            "totalTokenCount": usage.sent + usage.received,
        }
        counts |= {"cachedContentTokenCount": usage.read} if usage.read else {}
        return {
            "candidates": [candidate],
            "modelVersion": asked.model,
            "responseId": "r1",
            "usageMetadata": counts,
        }

    def error(self, refused: Refused) -> Fields:
        told: Fields = {
            "code": refused.status,
            "message": refused.message,
            "status": STATES[refused.status],
        }
        if (wait := refused.details.get("wait")) is not None:
            kind = "type.googleapis.com/google.rpc.RetryInfo"
            told["details"] = [{"@type": kind, "retryDelay": f"{wait}s"}]
        return {"error": told}
