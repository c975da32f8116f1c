# ruff: noqa: E501
"""Scenes whose files were ported to another interface, and that keep the digest they had before.

The digest of a scene is that of its text, because planning a dataset must not run scripts. A port changes the text and
not what the script makes: a scene is listed here after it was seen to make the same meshes, surfaces and lamps, bit for
bit (``tests/render/test_ported_scenes.py``). Its stacks and recordings then remain valid. Any further edit gives the
scene a digest of its own.
"""

PORTED = {
    # bookshelf
    "93671c2fcb2c90fc9313fbcc9e4b5922b57dc049a9cea771aa148a5da33bf93a": "67a1018e6974c2d68aea581cf02d1b393afd52b4a8c6e20cab676eebd83e8d3e",
    # bottle
    "42dbd19b1641ad090b4320e7df27294f143cbb4bea8721451dea0656ab6208f7": "e8789a07c55bb0cb1068282e293ef321e2b74c25d51775d2eb8cb0107956fe1d",
    # camel
    "d65e202fce48c03900e85ac948801b134b65f21f2215c8eea317b7a3dc5f67f8": "31353471ffe8b9cf2cf49772371b11172dcd3fe0a7045df48835f769d1da6422",
    # cardiac_muscle
    "344eea92810f81e57ee325f4769208cbf228b8706c27eb639629863c55c164d5": "cd2c3a2d3e907ed464377d2cdfc5869081a25df1ef68efa9d409a51de553abbd",
    # crossroad
    "70632665c924cf750223ca88e94c6c00775ad22c651434973c7197fa2de396a6": "94e42938e11759ecccb2b344d9471e99bbe8d3831ad273f6876cd9da66cb40b7",
    # fan
    "6fbe59a6243e1cfa1acdb1ea1af4a938e1ea33e42f38e2d46c3859256dfd518b": "16e860b9de757ba966460fffe9dfc11d9dbcb36f7b3f383d75648f9da5caf2e1",
    # foliage
    "0e4fba041dca66d36511f403bdf788ab43b99f778328b0a3ee57f1a15c4d8c9b": "d8487486c8ebfd8ff08815b70eae5e418ee90817b78e8f753680c847e29218f8",
    # lily_anther
    "60f09e2f977a7c891b83c6380a4fab436dbb715d4e4bb737e3d2bf4bd6f652c0": "7a2181d479da30a523bbeb914c508723b084b3aeeea1b79eb08b4f1613e7f117",
    # low_texture
    "f522e8ab993bec79b2b3a30a172271e68d8601dfcb024a2a8a54674dffe86b80": "db73dc724b4ad73ad9a06af2a4bc054e887f141f241f1ebf18d7e5648413cd7a",
    # night_street
    "077827ee3b1f692bd13db0acaa69e4463f4836f0eb21bbb624f2e011628e7e67": "a2382838dac27a8cb2173546317732f62b54d4202f12c3a958c1d30dabbcd74b",
    # speculars
    "91375a2bae03acbfad43bec3f2483c0f4292fe02a04c7a69af85a811576d0c79": "cb8718c38e03902076c7c6cb19bbfad6e28d7892c2366443398e1c40aee9d86f",
    # two_planes
    "8bf22abeaaafb70abab93a4d7f77e00ba1ad232b7b156eebff570e4be4fb4358": "6fe7c14ebc150e3b634207a1d7c24d7419aba92c31b75e04928ccfc1d0ae0569",
    # usaf_microscope
    "2f0bc58f7597d623dcbb628a5432dbdaad070d6148172d22829001cd937d77fd": "78969d1eb1b54cb92dfc2776d5dc7a3695ff30cfc2d983ce95308403f6543391",
    # usaf_target
    "1b2f4ccfa2330210821f646ee39df88b5ab7aac6d754ce4ffce16c3a96a97cd3": "47cfe6b569d60830dce84420b269f3b8b66ee4e3782e0136e3ded3b2fa47ff8a",
}
"""Digests before the port, by digests of the text."""
